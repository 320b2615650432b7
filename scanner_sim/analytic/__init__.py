"""The judge: the paper's closed forms and other published ones, written apart from the simulator.

Plain functions of numbers and float64 NumPy arrays in SI units. Nothing here is used by the simulator, and
nothing of the simulator's physics is used here: where both agree, two derivations agree.

- :mod:`~scanner_sim.analytic.geometry`: triangulation, two mirrors, error propagation, chief rays
- :mod:`~scanner_sim.analytic.beam`: the Gaussian beam
- :mod:`~scanner_sim.analytic.spot`: the image of the spot and the light budget in closed form
- :mod:`~scanner_sim.analytic.quadrature`: the image of the spot by dense integration
- :mod:`~scanner_sim.analytic.estimators`: peak estimators on one line, one pixel after the other
- :mod:`~scanner_sim.analytic.noise`: bounds and first-order errors of the spot's position
- :mod:`~scanner_sim.analytic.budget`: what each source of error makes of the range of a facing target
- :mod:`~scanner_sim.analytic.sun`: sunlight against laser light
- :mod:`~scanner_sim.analytic.retroreflector`: retro-reflecting sheets, beside the laser and around it
- :mod:`~scanner_sim.analytic.orbit`: eclipses, Earthshine and the Sun's place
- :mod:`~scanner_sim.analytic.pose`: errors of the pose of a square array
- :mod:`~scanner_sim.analytic.tracking`: a disc under the spot, and the bound on its centre
"""
