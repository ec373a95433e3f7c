"""How constraints are projected (lines 9-11). A method is a frozen description with `iterations` and `bind(sim)`; what
`bind` returns has `solve()`."""

from pbd_warp.methods.jacobi import Jacobi

METHODS = {"jacobi": Jacobi}

__all__ = ["METHODS", "Jacobi"]
