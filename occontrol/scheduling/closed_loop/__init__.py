"""Policies side by side on simulated runs, whoever simulates them: outcomes, confidence, when it is decided."""
