"""Numerical methods in JAX: arrays, roots, least squares, integration, tables, polynomials and random numbers.

====================  ================================================================================================
``arrays``            arrays and pytrees without compilation, precision, rows, equally structured objects for `vmap`
``roots``             roots of a scalar function within a bracket
``least_squares``     damped methods for nonlinear equations, and the derivative of the solution
``linear``            small dense matrices, block tridiagonal systems
``integration``       Runge-Kutta steps, quadrature rules
``tables``            multilinear interpolation
``bernstein``         polynomials in Bernstein form, bounded by their coefficients
``randomness``        random numbers as functions of seed, flight, aircraft, part and sample
``multisine_phases``  phases of multisines with a small range of values
====================  ================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
