"""First-fit colours (Welsh, Powell 1967): constraint by constraint, the lowest colour that none of its points has met. One
thread on the CPU: sequential by nature, and for millions faster so than any parallel form in NumPy."""

from functools import cache

import warp as wp


@cache
def first_fit(points: int, module="unique"):
    """Kernel (one thread): colour of each constraint in the given order; `met` holds a bit for each of 64 colours that a point
    has met. A constraint that finds all of them taken keeps its entry."""
    ids_type = wp.types.vector(points, int)

    @wp.kernel(module=module, enable_backward=False, name=f"first_fit_{points}")
    def first_fit(ids: wp.array(dtype=ids_type), order: wp.array(dtype=int), met: wp.array(dtype=wp.uint64),
                  color_out: wp.array(dtype=int)):
        one = wp.uint64(1)
        for n in range(order.shape[0]):
            c = order[n]
            p = ids[c]
            taken = wp.uint64(0)
            for k in range(points):
                taken |= met[p[k]]
            color = int(0)
            while color < 64 and (taken >> wp.uint64(color)) & one != wp.uint64(0):
                color += 1
            if color < 64:
                color_out[c] = color
                for k in range(points):
                    met[p[k]] = met[p[k]] | (one << wp.uint64(color))

    return first_fit
