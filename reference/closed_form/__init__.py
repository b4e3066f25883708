"""Exact values in float64 NumPy, one module per kind of scene; they share no code with a technique."""
