"""What Newton's method (newton.py) works on: arrays of one model, in float64 whatever the precision of its state."""

from __future__ import annotations

import warp as wp


@wp.struct
class Schedule:
    """The order of elimination (step/methods/schedule.py)."""

    piece_first: wp.array[wp.int32]  # [piece_count + 1]
    particle: wp.array[wp.int32]  # [tile_count]
    column_first: wp.array[wp.int32]  # [tile_count + 1]
    row: wp.array[wp.int32]  # [slot_count]
    row_first: wp.array[wp.int32]  # [tile_count + 1]
    row_slot: wp.array[wp.int32]  # [slot_count]
    row_column: wp.array[wp.int32]  # [slot_count]
    link_first: wp.array[wp.int32]  # [tile_count + 1]
    other: wp.array[wp.int32]  # [link_count] tile at the other end, -1: fixed
    partner: wp.array[wp.int32]  # [link_count] particle at the other end
    slot: wp.array[wp.int32]  # [link_count] of the tile where both ends meet, -1: none
    fresh: wp.array[wp.int32]  # [link_count] 1: the first link of its slot
    filled: wp.array[wp.int32]  # [slot_count] 1: no link has this slot


@wp.struct
class Matrix:
    """The matrix and its factors (elimination.py), and the right side."""

    D: wp.array[wp.mat33d]  # [tile_count] diagonal, zero between steps
    F: wp.array[wp.mat33d]  # [tile_count] factors of the diagonal
    low: wp.array[wp.mat33d]  # [slot_count] below the diagonal
    up: wp.array[wp.mat33d]  # [slot_count] above it
    b: wp.array[wp.vec3d]  # [tile_count] right side, then the solution du; zero between steps
    swap: wp.array[wp.mat33d]  # [tile_count] permutation of a tile's rows, or None: nobody asks
    where: wp.array[wp.int32]  # [tile_count] place of a row in the column in hand


@wp.struct
class Particles:
    """Those with a tile."""

    give: wp.array[wp.float64]  # [tile_count] proximal compliance of points [1/kg]
    mean_length: wp.array[wp.float64]  # [piece_count] of a piece's links [m]
    weight: wp.array[wp.float64]  # [tile_count] inverse mass now, 0: held [1/kg]
    mass: wp.array[wp.float64]  # [tile_count] its inverse, 0: held [kg]
    stiffness: wp.array[wp.float64]  # [tile_count] across links and contacts that carry, and mass; or None [kg]
    free: wp.array[wp.vec3d]  # [tile_count] displacement without constraints [m]
    move: wp.array[wp.vec3d]  # [tile_count] displacement u [m]
    shift: wp.array[wp.vec3d]  # [tile_count] what constraints moved in the step before, and now [m]
    gives: wp.array[wp.int32]  # [piece_count] steps until links that had to give are tried as rigid ones
    strain: wp.array[wp.float64]  # [piece_count] how far they gave, over their length
    missed: wp.array[wp.int32]  # [piece_count] solutions so far that did not converge


@wp.struct
class Links:
    """Distances in the order of the schedule."""

    proximal: wp.array[wp.float64]  # [link_count] compliance in the matrix alone [1/kg]
    elastic: wp.array[wp.float64]  # [link_count] compliance of links that have to give [1/kg]
    softest: wp.array[wp.float64]  # [link_count] the most negative kappa [kg]
    firm: wp.array[wp.float64]  # [link_count] 1 / the compliance in the matrix, of a rigid link [kg]
    steadies: wp.array[wp.float64]  # [link_count] the part of it that is proximal [1/kg]
    fixed: wp.array[wp.vec4d]  # [link_count] rest length, compliance over the force scale, |d_0|, w_i + w_j
    before: wp.array[wp.vec3d]  # [link_count] d_0 [m]
    start: wp.array[wp.vec3d]  # [link_count] d_0, less the displacement of an end that is fixed [m]
    normal: wp.array[wp.vec3d]  # [link_count] n
    row: wp.array[wp.vec4d]  # [link_count] from link_row to link_step
    lam: wp.array[wp.float64]  # [link_count] [kg m], negative where it pulls
    vector_lam: wp.array[wp.vec3d]  # [link_count] of links without length, or None: there are none


@wp.struct
class Progress:
    """Of Newton's method on one piece."""

    used: wp.int32  # iterations
    began: wp.int32  # the one in which rigid or elastic links were chosen
    rigid: wp.bool
    polishing: wp.bool  # rigid again, from where elastic links converged
    done: wp.bool
    error: wp.float64  # what is left of links and points over what is tolerated
    contact: wp.float64  # the same of contacts
    gave: wp.float64  # how far a link gives over its length
    widest: wp.float64  # how far the ends of a link moved apart in the last iteration, over its length
    touch: wp.float64  # over a particle's stiffness: what its contacts give


@wp.struct
class Points:
    """Point constraints of particles with a tile; None where there are none."""

    first: wp.array[wp.int32]  # [tile_count + 1]
    which: wp.array[wp.int32]  # [points with a tile] number of the constraint, tile by tile
    gone: wp.array[wp.vec3d]  # [point_count] from the target to the particle at the start of the step [m]
    soft: wp.array[wp.float64]  # [point_count] compliance over the force scale [1/kg]
    lam: wp.array[wp.vec3d]  # [point_count] force on the particle [kg m]


@wp.struct
class Bends:
    """Triples that resist bending (bending_row.py), piece by piece; None where there are none."""

    first: wp.array[wp.int32]  # [piece_count + 1]
    particle: wp.array[wp.vec3i]  # [bend_count] i, j, k
    tile: wp.array[wp.vec3i]  # [bend_count] theirs, -1: fixed
    slot: wp.array[wp.vec3i]  # [bend_count] of the tiles where i and j, j and k, i and k meet, -1: none
    shape: wp.array[wp.vec3d]  # [bend_count] B / l [N m], l [m], rest
    before1: wp.array[wp.vec3d]  # [bend_count] e_1 at the start of the step [m]
    before2: wp.array[wp.vec3d]  # [bend_count] e_2
    start1: wp.array[wp.vec3d]  # [bend_count] e_1 with the displacement of ends that are fixed [m]
    start2: wp.array[wp.vec3d]  # [bend_count] e_2
    scale: wp.array[wp.float64]  # [piece_count] the integrator's force scale [s^2]
    exact: wp.array[wp.int32]  # [piece_count] 1: the matrix has the exact derivatives
    load: wp.array[wp.vec3d]  # [tile_count] the right side before the matrix is filled
    softest: wp.array[wp.float64]  # [link_count] the most negative kappa where the matrix is not positive [kg]


@wp.struct
class Touching:
    """Contacts with what is fixed or led (touch.py); None where there are none."""

    rubs: wp.float64  # over a particle's stiffness: what friction gives at least
    head: wp.array[wp.int32]  # [particle_count] first of its contacts, or -1
    following: wp.array[wp.int32]  # [capacity] next contact of the same particle, or -1
    side: wp.array[wp.vec3d]  # [capacity] normal as found, out of what is fixed; 0: round
    start: wp.array[wp.vec3d]  # [capacity] from the centre of what is round, its displacement taken off [m]
    led: wp.array[wp.vec3d]  # [capacity] displacement of what is fixed or led [m]
    surface: wp.array[wp.vec4d]  # [capacity] gap at the start, radius (negative: flat), friction, rounding of x [m]
    lam: wp.array[wp.float64]  # [capacity] push [kg m]
    grip: wp.array[wp.vec3d]  # [capacity] friction [kg m]
    status: wp.array[wp.int32]  # [capacity] OPEN, STICKS or SLIDES
