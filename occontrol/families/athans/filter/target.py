"""The matched filter for code on a target: the sampled model and the prediction, as core/target.py wants them."""

from __future__ import annotations

from occontrol.core.schedule import Schedule
from occontrol.core.target import TargetModel, TargetPlan
from occontrol.families.athans.filter.online import MODELS
from occontrol.families.athans.filter.predictor import Predictor, make_predictor
from occontrol.families.athans.filter.sampled_model import SampledModel
from occontrol.families.athans.problem import SchedulingProblem


def target_plan(problem: SchedulingProblem, schedule: Schedule, model: str) -> TargetPlan:
    """The schedule and its filter for code on a target.

    Parameters
    ----------
    problem : SchedulingProblem
    schedule : to follow
    model : "split" or "exact"
    """
    sampled = MODELS[model](problem, schedule)
    return plan_of(sampled, make_predictor(problem, sampled), predicted_for=f" at t = {problem.predict_at:g}")


def plan_of(
    model: SampledModel,
    predictor: Predictor,
    instants: bool = False,
    variable: str = "t",
    predicted_for: str = "",
) -> TargetPlan:
    """A sampled model as a TargetPlan.

    Parameters
    ----------
    model : SampledModel
    predictor : on its nodes
    instants : whether its values are readings at the ends of the intervals
    variable : "t" or "k"
    predicted_for : the time of the prediction in words
    """
    return TargetPlan(
        edges=model.edges,
        names=model.names,
        rows=model.rows,
        active=model.active,
        instants=instants,
        variable=variable,
        predicted_for=predicted_for,
        model=TargetModel(
            transition=model.transition,
            input=model.input,
            observe=model.observe,
            offset=model.offset,
            noise_root=model.noise_roots,
            mean=model.mean,
            covariance=model.covariance,
            predict_matrix=predictor.matrix,
            predict_offset=predictor.offset,
            predict_noise=predictor.noise,
        ),
    )
