"""Heun's method of order 2, as a Runge-Kutta tableau."""

import redundant_envs as rde

HEUN = rde.Tableau(name="heun", order=2, a=((), (1.0,)), b=(0.5, 0.5), c=(0.0, 1.0))
rde.register_integrator(HEUN)
