"""Comparison of a simulation with closed forms: each law that applies to a scenario is measured and judged.

- :mod:`~scanner_sim.validation.compare.law`: what a law is, what is measured and what is predicted
- :mod:`~scanner_sim.validation.compare.judge`: intervals, probabilities, the family of checks, power
- :mod:`~scanner_sim.validation.compare.comparison_setup`: the scenario, the targets and the effort of a comparison
- :mod:`~scanner_sim.validation.compare.test_bench`: the scenario's instrument before flat targets
- :mod:`~scanner_sim.validation.compare.laws`: all laws, and the modules that hold them
- :mod:`~scanner_sim.validation.compare.run`: the whole comparison
- :mod:`~scanner_sim.validation.compare.baseline`: comparison with an earlier one

Predictions come from :mod:`scanner_sim.analytic` and numbers of the scenario alone; measurements from the simulator
alone. The two meet in the judge.
"""
