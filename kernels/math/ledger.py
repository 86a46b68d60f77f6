"""Energy balance of every world at the end of a frame, one-sided: energy may be lost, and must not come from nowhere.

    K       kinetic energy [J]
    S, T    least and most energy that is stored [J]: equal where it is known, S = 0 where a solver leaves a part unsolved
    W       work done in the frame by gravity, loads, moving colliders, wind and drives [J], or more than that
    B       least K + T of the frames so far, each with the work done since added [J]

    rise = K + S - B      what no work explains; B' = min(B + W, K + T)

The rise is too much where it exceeds `part` of the largest K so far and a floor. B begins anew behind such a frame, and behind
one that is left open, in which something works whose work is not known. There K alone is judged, loosely: it may be SPEEDS
times what is there and what moves can give, M (2 u)^2 / 2 of masses M that are hit at a speed u.

Each term of the balance leaves a row (K, S, T, W) for each of a fixed number of threads of each world, without atomics: results
are the same from run to run. All of it is float64.
"""

import warp as wp

SPEEDS = wp.constant(wp.float64(4.0))


@wp.struct
class EnergyLedger:
    """Of each world, (worlds,)."""
    gift: wp.array(dtype=wp.float64)           # of a frame that is left open: what moves can give [J]; < 0: it is not
    floor: wp.array(dtype=wp.float64)          # [J]
    lowest: wp.array(dtype=wp.float64)         # B [J]
    most: wp.array(dtype=wp.float64)           # largest K so far [J]
    peak: wp.array(dtype=wp.float64)           # largest rise so far [J]
    rise: wp.array(dtype=wp.vec4d)             # of the last frame: rise, what it may be, K, W [J]


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    for (unsigned k = lanes / 2; k > 0; k >>= 1)
        for (int c = 0; c < 4; ++c) v[c] += __shfl_xor_sync(0xffffffffu, v[c], k);
#endif
    return v;
""")
def sum_lanes(v: wp.vec4d, lanes: int) -> wp.vec4d:
    """Sum over the lanes of a warp, the same in each."""
    ...


@wp.kernel(module="wsim_ledger", enable_backward=False)
def close_frame(rows: wp.array(dtype=wp.vec4d), terms: int, lanes: int, part: wp.float64, ledger: EnergyLedger,
                word: wp.array(dtype=int)):
    """So many lanes a world, 1 or a warp of a GPU. rows: those of its threads, term by term, (terms, worlds, threads). word: 1
    where energy rose too much, 2 where speeds did."""
    w = wp.tid() // lanes
    lane = wp.tid() % lanes
    worlds = ledger.lowest.shape[0]
    threads = rows.shape[0] // (terms * worlds)
    sum = wp.vec4d()
    for term in range(terms):
        first = (term * worlds + w) * threads
        for k in range(lane, threads, lanes):
            sum += rows[first + k]
    sum = sum_lanes(sum, lanes)
    if lane > 0:
        return
    upper = sum[0] + sum[2]
    ledger.most[w] = wp.max(ledger.most[w], sum[0])
    bound = part * ledger.most[w] + ledger.floor[w]
    before = ledger.lowest[w] + sum[3]
    more = sum[0] + sum[1] - before
    gift = ledger.gift[w]
    if gift >= wp.float64(0.0):
        more = wp.float64(0.0)
        if sum[0] > SPEEDS * (wp.max(before, wp.float64(0.0)) + gift) + ledger.floor[w]:
            word[w] = 2
        before = upper
    ledger.rise[w] = wp.vec4d(more, bound, sum[0], sum[3])
    ledger.lowest[w] = wp.min(before, upper)
    ledger.peak[w] = wp.max(ledger.peak[w], more)
    if more > bound:
        word[w] = 1
        ledger.lowest[w] = upper


@wp.kernel(module="wsim_ledger", enable_backward=False)
def open_frame(speed: wp.array(dtype=wp.float64), still: wp.float64, mass: wp.float64, given: wp.array(dtype=wp.float64),
               gift_out: wp.array(dtype=wp.float64), word: wp.array(dtype=int)):
    """A thread a world. speed: of pins in the frame [m/s], (pins,): one above `still` leaves the frame open; given: gift of
    what else works, (worlds,). word: number of the first pin that moves, and 1; 0: none does."""
    w = wp.tid()
    most = wp.float64(0.0)
    first = int(0)
    for p in range(speed.shape[0]):
        if speed[p] > still and first == 0:
            first = p + 1
        most = wp.max(most, speed[p])
    gift = given[w]
    if first > 0:
        gift = wp.max(gift, wp.float64(2.0) * mass * most * most)
    gift_out[w] = gift
    if w == 0:
        word[0] = first


@wp.kernel(module="wsim_ledger", enable_backward=False)
def store_energy(sums: wp.array(dtype=wp.vec3d), first: int, least: wp.float64, rows: wp.array(dtype=wp.vec4d)):
    """A thread a row: elastic energy sums[2] [J] as stored; least: the part of it that is known to be there."""
    i = wp.tid()
    U = sums[i][2]
    rows[first + i] = wp.vec4d(wp.float64(0.0), least * U, U, wp.float64(0.0))
