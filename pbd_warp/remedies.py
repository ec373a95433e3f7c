"""What helps against failures that are known: said before a run, after one that failed, and in the atlas."""

REMEDIES = {
    "relaxation": "keep averaging='mass-splitting' and the relaxation at 1",
    "star": "use averaging='mass-splitting', GaussSeidel, or a smaller relaxation",
    "overconstrained": "use averaging='mass-splitting', or give each distance once",
    "sweeps": "use an even number of iterations, or a relaxation of 1",
    "chain_length": "use Direct, or more substeps",
    "mass_ratio": "use Direct, or more substeps",
    "chebyshev": "use a smaller rho for what moves, or Direct",
    "sweep_energy": "use Direct, 5 iterations or more, or integrator 'bdf2'",
    "step": "use integrator 'bdf2', or more substeps",
    "precision": "use float64, or move the scene to the origin",
    "drag": "use Direct, or more substeps",
    "speed": "use more substeps, or float64",
    "overlap": "start without overlap, or limit the depenetration speed",
    "unreachable": "hold them nearer to each other, or give the links a compliance",
    "cradle": "leave gaps wider than a step's way",
    "coincident": "start particles apart, or use more iterations",
    "capstan": "use Direct",
    "short_link": "use Direct, or float64",
    "loops": "use more substeps",
    "bending": "use Direct, or more substeps, and start without folds",
}
"""What was seen to help against each failure of the atlas, by the name of the check and of the map."""
