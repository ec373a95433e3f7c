"""How constraints are projected (lines 9-11). A method is a frozen description with `name`, `iterations`, `tolerance`,
`remedy` (what to try when it diverges), `valence(model)` and `bind(context, contacts)`; what `bind` returns has
`solve(stage)`, `restart()`, which forgets the past, and `counters`: int32 [2] on the device, iterations of the frame
and how many steps did not reach the tolerance, None without one."""

from pbd_warp.step.methods.direct import Direct
from pbd_warp.step.methods.gauss_seidel import GaussSeidel
from pbd_warp.step.methods.jacobi import Jacobi

METHODS = {method.name: method for method in (Jacobi, GaussSeidel, Direct)}
Method = Jacobi | GaussSeidel | Direct

__all__ = ["METHODS", "Direct", "GaussSeidel", "Jacobi", "Method"]
