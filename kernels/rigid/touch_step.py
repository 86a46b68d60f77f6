"""The substep of kernels/rigid/soft_step.py in three launches, between which points push the bodies (kernels/rigid/touch.py).

    begin     impacts, forces, and the impulses that the substep before has left
    sweep     bodies against each other and against colliders, in turn with the points
    end       places, and sweeps without bias
"""

import warp as wp

from wsim.kernels.math.rotation import matrix
from wsim.kernels.rigid.contact import whole
from wsim.kernels.rigid.impact import impacts
from wsim.kernels.rigid.impulse import formulas
from wsim.kernels.rigid.soft_step import body_steps, sweeps


def touch_step(real, module, bouncing: bool) -> tuple:
    """Kernels begin, sweep, end of one thread: substep steps[0] of a frame, of h [s], with steps[2] sweeps."""
    Rig = whole(real)
    prepare = formulas(real)[1]
    warm, solve = sweeps(real)
    oriented, forces, place = body_steps(real)
    if bouncing:
        thrown = impacts(real)
    else:
        @wp.func
        def thrown(k: int, h: real, manifolds: int, rig: Rig):
            return

    @wp.func
    def placed(k: int, count: int, rig: Rig):
        """Arms and gaps as bodies and colliders are where substep k begins."""
        n = rig.b.w.shape[0]
        for i in range(n):
            oriented(i, rig)
        for f in range(rig.work.turn.shape[0] - n):
            rig.work.turn[n + f] = matrix(rig.still.q[k * rig.still.moving, f])
        for m in range(count):
            prepare(m, k, rig)

    def rigid_touch_begin(steps: wp.vec3i, h: real, manifolds: wp.array(dtype=int), rig: Rig):
        count = wp.min(manifolds[0], rig.c.a.shape[0])
        k = steps[0]
        placed(k, count, rig)
        thrown(k, h, count, rig)
        for i in range(rig.b.w.shape[0]):
            forces(i, h, rig)
        for m in range(count):
            warm(m, k, rig)

    def rigid_touch_sweep(steps: wp.vec3i, h: real, manifolds: wp.array(dtype=int), rig: Rig):
        count = wp.min(manifolds[0], rig.c.a.shape[0])
        for _sweep in range(steps[2]):
            for m in range(count):
                solve(m, steps[0], h, 1, rig)

    def rigid_touch_end(steps: wp.vec3i, h: real, manifolds: wp.array(dtype=int), rig: Rig):
        count = wp.min(manifolds[0], rig.c.a.shape[0])
        k = steps[0]
        for i in range(rig.b.w.shape[0]):
            place(i, h, rig)
        placed(k + 1, count, rig)
        for m in range(count):
            solve(m, k, h, 0, rig)

    return tuple(wp.kernel(each, name=each.__name__, module=module, enable_backward=False)
                 for each in (rigid_touch_begin, rigid_touch_sweep, rigid_touch_end))
