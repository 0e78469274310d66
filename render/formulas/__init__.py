"""Formulas in kernels: tapes evaluated at once by interpreters, later by code of their own, and the surfaces they describe traced."""
