"""Warp kernels of the simulation: maths as `@wp.func`, one kernel a job, nothing of ours imported from outside."""
