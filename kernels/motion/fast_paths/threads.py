"""CPU threads that go through the points of a march abreast (kernels/motion/fast_paths/march_cpu.py), each through a part of
them, pass after pass.

A pass takes every point in order; a point adds to later ones and reads where they are. So part r may begin pass t when part
r - 1 has ended it, and part r may take its tail, the points with a spring to part r + 1, when that one has moved its head,
the points that part r reaches, in pass t - 1:

    begin(r, t) >= end(r - 1, t),    tail(r, t) >= head(r + 1, t - 1)

Each thread thus walks one pass behind the one before it, and waits for nobody while heads and tails are short. The sums and
their order are those of one thread, whatever the parts: so are the bits. No barrier: two words a thread and pass.

The thread that launches the frame leads. It walks alone until all that are called have come, then shares out the rest of the
passes; where they do not come, it walks alone to the end. A helper that finds no frame, or comes too late, leaves. Who waits
long gives up the core: threads whose cores others have taken come on slowly, but they do come on. Words are read and written
by Clang's atomics; Warp's are none on a CPU. DOOR: frame number, and in the low bits how many have come, or SHUT.
"""

from functools import cache

import warp as wp

DOOR, CALL, FORMED, FROM, LEFT, STALLS, DONE = range(7)      # words of the desk; DONE of rank r is at DONE + r
APART = 32             # ints from word to word: two cache lines, since processors fetch them in pairs
MOST = 16              # threads
SHUT = 63              # in the low six bits of DOOR
SPIN = 600_000         # cycles of waiting before the core is given up, 150 to 260 us: longer than a nap, since else one nap
                       # of one thread keeps the others waiting, who nap in turn (0.55 of one thread's time became 0.75 to 0.9)
NAP = 20               # [us] for which it is given up; Linux makes 75 to 110 of them
NEVER = 2**30          # naps until a wait is given up that will end
PATIENCE = 100         # naps for which a helper looks for an open door

TOOLS = """
    typedef signed (*Nap)(unsigned);
    unsigned* desk = (unsigned*)(((unsigned long long)team.desk.data + 127) / 128 * 128);
    auto look = [&](int word) {{ return __atomic_load_n(desk + {APART} * word, __ATOMIC_ACQUIRE); }};
    auto say = [&](int word, unsigned value) {{ __atomic_store_n(desk + {APART} * word, value, __ATOMIC_RELEASE); }};
    #if defined(__x86_64__)
    auto cycles = [](unsigned long long round) {{ return __builtin_ia32_rdtsc(); }};
    auto breathe = [] {{ __builtin_ia32_pause(); }};
    #else
    auto cycles = [](unsigned long long round) {{ return 4 * round; }};
    auto breathe = [] {{}};
    #endif
    auto until = [&](auto come, int most) {{
        const unsigned long long begun = cycles(0);
        int naps = 0;
        for (unsigned long long round = 0; !come() && naps < most; ++round)
            if (cycles(round) - begun < {SPIN}) breathe();
            else {{ ((Nap)team.nap)({NAP}); ++naps; }}
        return naps;
    }};
"""
WALK = """
    auto part = [&](int r, int* leg) {{ for (int l = 0; l < 4; ++l) leg[l] = team.part.data[4 * r + l]; }};
    int rank = 0, walkers = 1, t = 0, stalls = 0, leg[4] = {{0, blocks, blocks, blocks}};
    unsigned frame = 0;
"""
# A helper looks for an open door, and waits behind it until it is shut, or another frame has begun; rank 0: it found none.
ENTER = """
        until([&] {{
            unsigned door = look({DOOR});
            if ((int)(door & 63) < team.count - 1 && look({CALL}) == (unsigned)-team.call
                    && __atomic_compare_exchange_n(desk, &door, door + 1, false, __ATOMIC_ACQ_REL, __ATOMIC_RELAXED)) {{
                frame = door >> 6;
                rank = 1 + (door & 63);
            }}
            return rank > 0;
        }}, {PATIENCE});
        if (rank > 0) until([&] {{ return look({DOOR}) >> 6 != frame || (look({DOOR}) & 63) == {SHUT}; }}, {NEVER});
"""
JOIN = """
    if (team.call < 0) {{
""" + ENTER + """
        if (rank == 0) return;
        if (look({FORMED}) != frame) return;
        t = look({FROM});
        walkers = team.count;
        part(rank, leg);
    }}
"""
# by the leader, when the points are where helpers look for them
OPEN = """
    if (team.call > 0) {{
        frame = ((look({DOOR}) >> 6) + 1) & 0x3ffffff;
        say({CALL}, team.call); say({LEFT}, 0); say({STALLS}, 0);
        say({DOOR}, frame << 6);
    }}
"""
# before and after leg l (head, middle, tail) of pass t
BEFORE = """
            if (walkers > 1 && l != 1) {{
                const int other = l == 0 ? rank - 1 : rank + 1;
                if (other >= 0 && other < walkers) {{
                    const int least = l == 0 ? 2 * t + 2 : 2 * t - 1;
                    stalls += until([&] {{ return (signed)look({DONE} + other) >= least; }}, {NEVER}) > 0;
                    const int* far = team.part.data + 4 * (l == 0 ? rank : other);
                    for (int i = 8 * group[far[0]]; i < 8 * group[far[1]]; i += 4) {{
                        __builtin_prefetch(D + i, 1);
                        __builtin_prefetch(F + i, 1);
                    }}
                }}
            }}
"""
AFTER = "if (walkers > 1 && l != 1) say({DONE} + rank, 2 * t + 1 + (l == 2));"
# by the leader, between passes
FORM = """
        if (team.call > 0 && walkers == 1 && t + 2 * team.count < count && (int)(look({DOOR}) & 63) == team.count - 1) {{
            walkers = team.count;
            part(0, leg);
            for (int r = 0; r < walkers; ++r) say({DONE} + r, 2 * t + 2);
            say({FROM}, t + 1); say({FORMED}, frame);
            say({DOOR}, frame << 6 | {SHUT});
        }}
"""
# when all is stored: nobody reads or writes for this frame after the leader has returned
LEAVE = """
    if (rank > 0) {{
        __atomic_fetch_add(desk + {APART} * {STALLS}, stalls, __ATOMIC_RELAXED);
        __atomic_fetch_add(desk + {APART} * {LEFT}, 1, __ATOMIC_RELEASE);
    }} else if (walkers > 1) {{
        until([&] {{ return look({LEFT}) + 1 == (unsigned)walkers; }}, {NEVER});
        say({STALLS}, look({STALLS}) + stalls);
    }} else if (team.call > 0) say({DOOR}, frame << 6 | {SHUT});
"""
_NUMBERS = {name: value for name, value in globals().items() if isinstance(value, int)}
TEXTS = {name: text.format(**_NUMBERS) for name, text in
         {"tools": TOOLS, "walk": WALK, "join": JOIN, "open": OPEN,
          "before": BEFORE, "after": AFTER, "form": FORM, "leave": LEAVE}.items()}


@cache
def team_type():
    """Struct of those that may walk together."""

    @wp.struct
    class WalkerTeam:
        desk: wp.array(dtype=int)            # words, see above; zeros, but for the door, which is shut
        part: wp.array(dtype=int)            # of each thread: its first block, the ends of its head, its middle and its tail
        count: int                           # threads
        call: int                            # number of the arguments, of helpers negative: those of the leader; 0: walk alone
        nap: wp.uint64                       # address of usleep

    return WalkerTeam
