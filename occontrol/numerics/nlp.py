"""CasADi and Ipopt behind one door: options, one status map, a check before the start, the best iterate kept.

CasADi swallows SIGINT and then returns f = 0.0, and so does a failed start. Nothing here is read from a solution
whose status was not looked at, and the best iterate lives in the iteration callback.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from occontrol.core.errors import SolveFailed
from occontrol.core.kinds import Casadi, CasadiFunction, CasadiSparsity, PlainDict
from occontrol.core.monitor import Monitor
from occontrol.core.solution import Status

# Ipopt's return status: the house's, and the sentence for the user
IPOPT_STATUS: dict[str, tuple[Status, str]] = {
    "Solve_Succeeded": (Status.FEASIBLE, "Ipopt found a point that meets its tolerances"),
    "Solved_To_Acceptable_Level": (Status.FEASIBLE, "Ipopt stopped at its acceptable, looser tolerances"),
    "Feasible_Point_Found": (Status.FEASIBLE, "Ipopt found a feasible point of a square problem"),
    "Maximum_Iterations_Exceeded": (Status.LIMIT, "Ipopt reached max_iterations; raise it"),
    "Maximum_CpuTime_Exceeded": (Status.LIMIT, "Ipopt reached its time limit; raise time_limit"),
    "Maximum_WallTime_Exceeded": (Status.LIMIT, "Ipopt reached its time limit; raise time_limit"),
    "User_Requested_Stop": (Status.LIMIT, "stopped at the time limit; raise time_limit"),
    "Search_Direction_Becomes_Too_Small": (Status.LIMIT, "Ipopt's steps became too small; use more intervals"),
    "Restoration_Failed": (Status.FAILED, "Ipopt could not restore feasibility; use more intervals"),
    "Infeasible_Problem_Detected": (
        Status.FAILED,
        "Ipopt converged to a point that is not feasible; use more intervals",
    ),
    "Diverging_Iterates": (Status.FAILED, "Ipopt's iterates diverge; scale the states"),
    "Invalid_Number_Detected": (Status.FAILED, "a function or derivative is not finite; scale the states"),
    "Error_In_Step_Computation": (Status.FAILED, "Ipopt could not compute a step; scale the states"),
    "Insufficient_Memory": (Status.FAILED, "the problem does not fit in memory; use fewer intervals"),
}


@dataclass(frozen=True, eq=False)
class Program:
    """minimise f(x) subject to lower <= x <= upper and g_lower <= g(x) <= g_upper.

    Parameters
    ----------
    variables, objective, constraints : CasADi expressions x (n,), f scalar, g (m,)
    lower, upper : (n,);  g_lower, g_upper : (m,)
    spell : from a row of g to words, for messages
    unit : a typical size of f; Ipopt sees f/unit, everybody else f
    jacobian : CasADi expression (m, n) of dg/dx where its structure is known; otherwise CasADi finds it
    """

    variables: Casadi
    objective: Casadi
    constraints: Casadi
    lower: np.ndarray
    upper: np.ndarray
    g_lower: np.ndarray
    g_upper: np.ndarray
    spell: Callable[[int], str] = field(default=lambda row: f"constraint {row}")
    unit: float = 1.0
    jacobian: Casadi | None = None


@dataclass(frozen=True)
class IpoptOptions:
    """What may be said to Ipopt; the Hessian is exact and the linear solver MUMPS.

    Parameters
    ----------
    max_iterations : int
    tolerance : of the scaled optimality conditions
    feasible : largest violation of a bound or constraint that still counts as feasible
    more : further Ipopt options by name
    """

    max_iterations: int = 300
    tolerance: float = 1e-8
    feasible: float = 1e-6
    more: tuple[tuple[str, str | float], ...] = ()


@dataclass(frozen=True, eq=False)
class NlpOutcome:
    """The best iterate: the feasible one of the lowest objective, or the least infeasible one.

    Parameters
    ----------
    x : (n,);  multipliers : (m,) of g, in L = f + multipliers' g
    objective, violation : at x
    iterations : of Ipopt
    status, message, native : in the house's words, and Ipopt's own status
    """

    x: np.ndarray
    multipliers: np.ndarray
    objective: float
    violation: float
    iterations: int
    status: Status
    message: str
    native: str


def solve_nlp(program: Program, start: np.ndarray, options: IpoptOptions, monitor: Monitor) -> NlpOutcome:
    """Solve by Ipopt, quietly; stop at `monitor.stop` and return the best iterate.

    Parameters
    ----------
    program : Program
    start : (n,)
    options : IpoptOptions
    monitor : Monitor, told of every iteration; SIGINT and SIGTERM during the solve set `monitor.interrupted`

    Raises SolveFailed when f, g or its Jacobian is not finite at the start, or when no iterate exists.
    """
    import casadi

    watcher = _watcher(program, options, monitor)
    settings: PlainDict = {
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.max_iter": options.max_iterations,
        "ipopt.tol": options.tolerance,
        "ipopt.linear_solver": "mumps",
        "ipopt.hessian_approximation": "exact",
        "print_time": False,
        "show_eval_warnings": False,
        "error_on_fail": False,
        "iteration_callback": watcher,
        **{f"ipopt.{name}": value for name, value in options.more},
    }
    if monitor.time_limit is not None:
        settings["ipopt.max_wall_time"] = max(monitor.time_limit - monitor.seconds, 0.01)
    problem = {"x": program.variables, "f": program.objective / program.unit, "g": program.constraints}
    if program.jacobian is not None:
        x, p = program.variables, casadi.MX.sym("p", 0, 1)
        pair = [program.constraints, program.jacobian]
        settings["jac_g"] = casadi.Function("nlp_jac_g", [x, p], pair, ["x", "p"], ["g", "jac_g_x"])
    solver = casadi.nlpsol("solver", "ipopt", problem, settings)
    check_start(program, solver, start)
    bounds = {"lbx": program.lower, "ubx": program.upper, "lbg": program.g_lower, "ubg": program.g_upper}
    native = "Invalid_Number_Detected"
    with interruptible(monitor):
        try:
            answer = solver(x0=start, **bounds)
            native = str(solver.stats()["return_status"])
            if native in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
                watcher.accept(*(np.array(answer[k]).ravel() for k in ("x", "g", "lam_g")), float(answer["f"]))
        except KeyboardInterrupt:
            monitor.interrupted = monitor.interrupted or int(signal.SIGINT)
        except RuntimeError as error:  # how CasADi reports an interrupt that it noticed itself
            if not monitor.stop:
                raise SolveFailed(f"Ipopt ended with an error: {error}") from None
    status, message = IPOPT_STATUS.get(native, (Status.FAILED, f"Ipopt ended with '{native}'"))
    if monitor.interrupted:
        status, message = Status.INTERRUPTED, "interrupted; this is Ipopt's best iterate so far"
    if watcher.best is None:
        raise SolveFailed(f"no iterate to return: {message}")
    x, multipliers, objective, violation = watcher.best
    return NlpOutcome(x, multipliers, objective, violation, watcher.iteration, status, message, native)


def check_start(program: Program, solver: CasadiFunction, start: np.ndarray) -> None:
    """Evaluate the functions that Ipopt will call; raise SolveFailed naming what is not finite at the start.

    `start` (variables,).
    """
    value, slope = (np.array(x).ravel() for x in solver.get_function("nlp_grad_f")(start, []))
    rows, jacobian = solver.get_function("nlp_jac_g")(start, [])
    if not np.isfinite(value[0]):
        raise SolveFailed(f"the objective is {value[0]} at the start")
    bad = np.flatnonzero(~np.isfinite(np.array(rows).ravel()))
    if len(bad):
        raise SolveFailed(f"{program.spell(int(bad[0]))} is not finite at the start")
    bad = np.flatnonzero(~np.isfinite(slope))
    if len(bad):
        raise SolveFailed(f"the derivative of the objective by variable {bad[0]} is not finite at the start")
    entries = np.array(jacobian.nonzeros())
    if not np.all(np.isfinite(entries)):
        row = jacobian.sparsity().get_triplet()[0][int(np.argmin(np.isfinite(entries)))]
        raise SolveFailed(f"the derivative of {program.spell(row)} is not finite at the start")


def _watcher(program: Program, options: IpoptOptions, monitor: Monitor) -> Any:
    import casadi

    sizes = {"x": program.variables.numel(), "f": 1, "g": program.constraints.numel(), "lam_p": 0}
    sizes |= {"lam_x": sizes["x"], "lam_g": sizes["g"]}

    class Watcher(casadi.Callback):
        """Ipopt's iteration callback: keeps the best iterate, reports, stops."""

        def __init__(self) -> None:
            casadi.Callback.__init__(self)
            self.best: tuple[np.ndarray, np.ndarray, float, float] | None = None
            self.iteration = -1
            self.construct("watcher", {})

        def get_n_in(self) -> int:
            return casadi.nlpsol_n_out()

        def get_n_out(self) -> int:
            return 1

        def get_name_in(self, i: int) -> str:
            return casadi.nlpsol_out(i)

        def get_sparsity_in(self, i: int) -> CasadiSparsity:
            return casadi.Sparsity.dense(sizes[casadi.nlpsol_out(i)], 1)

        def eval(self, arguments: list) -> list[int]:
            self.iteration += 1
            found = {casadi.nlpsol_out(i): a for i, a in enumerate(arguments)}
            x, g, multipliers = (np.array(found[k]).ravel() for k in ("x", "g", "lam_g"))
            self.accept(x, g, multipliers, float(found["f"]))
            if self.best is not None:
                monitor.report(self.iteration, self.best[2], -np.inf)
            return [1 if monitor.stop else 0]

        def accept(self, x: np.ndarray, g: np.ndarray, multipliers: np.ndarray, objective: float) -> None:
            if not (np.isfinite(objective) and np.all(np.isfinite(x)) and np.all(np.isfinite(g))):
                return
            objective *= program.unit
            over = [program.lower - x, x - program.upper, program.g_lower - g, g - program.g_upper]
            violation = max(float(np.max(part, initial=0.0)) for part in over)
            small = options.feasible
            if self.best is not None:
                before = self.best[3]
                better = objective <= self.best[2] if max(before, violation) <= small else violation < before
                if not better:
                    return
            self.best = (x, multipliers * program.unit, objective, violation)

    return Watcher()


@contextmanager
def interruptible(monitor: Monitor) -> Iterator[None]:
    """SIGINT and SIGTERM set `monitor.interrupted`; a second SIGINT raises KeyboardInterrupt. Restores the handlers.

    Signals belong to the main thread; elsewhere nothing is installed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: object) -> None:
        if monitor.interrupted and number == signal.SIGINT:
            raise KeyboardInterrupt
        monitor.interrupted = int(number)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
