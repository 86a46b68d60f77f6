"""CPU threads that take a launch of many phases together: each takes its share of a phase, and behind each phase all wait
for each other. They come and go as kernels/motion/fast_paths/threads.py has it: who launches leads, and is alone until all that
are called have come; then they share the steps that are left. Helpers that are late or missing leave them to it.

    rank    = join(team)                                       0: of the one that leads; -1: nothing is left to do
    step    = since(team, rank)                                the first that it takes part in
    walkers = together(team, rank, 0, step, steps)             threads that share it
    meet(team, rank, walkers)                                  behind each phase
    walkers = together(team, rank, walkers, step, steps)       behind each step: threads that share the next
    leave(team, rank, walkers)
"""

import warp as wp

from wsim.kernels.motion.fast_paths import threads
from wsim.kernels.motion.fast_paths.threads import ENTER, OPEN, TEXTS, team_type

NUMBERS = {name: value for name, value in vars(threads).items() if isinstance(value, int)}
JOIN = """
    int rank = 0;
    unsigned frame = 0;
""" + OPEN + """
    if (team.call >= 0) return 0;
""" + ENTER + """
    if (rank == 0) return -1;
    return look({FORMED}) == frame ? rank : -1;
"""
MEET = """
    if (walkers == 1) return;
    const unsigned turn = look({DONE} + rank) + 1;
    int stalls = 0;
    say({DONE} + rank, turn);
    for (int r = 0; r < walkers; ++r)
        if (r != rank) stalls += until([&] {{ return (signed)(look({DONE} + r) - turn) >= 0; }}, {NEVER});
    if (stalls > 0) __atomic_fetch_add(desk + {APART} * {STALLS}, stalls, __ATOMIC_RELAXED);
"""
TOGETHER = """
    if (rank > 0) return team.count;
    if (walkers < 1) return 1;
    if (walkers > 1 || team.call <= 0 || step + 2 * team.count >= steps) return walkers;
    const unsigned door = look({DOOR});
    if ((int)(door & 63) != team.count - 1) return 1;
    for (int r = 0; r < team.count; ++r) say({DONE} + r, 0);
    say({FROM}, step + 1);
    say({FORMED}, door >> 6);
    say({DOOR}, door | {SHUT});
    return team.count;
"""
LEAVE = """
    if (rank > 0) __atomic_fetch_add(desk + {APART} * {LEFT}, 1, __ATOMIC_RELEASE);
    else if (walkers > 1) until([&] {{ return look({LEFT}) + 1 == (unsigned)walkers; }}, {NEVER});
    else if (team.call > 0) say({DOOR}, look({DOOR}) | {SHUT});
"""
Team = team_type()


def team_function_text(body: str, otherwise: str = "") -> str:
    """C++ of a function on a CPU, and elsewhere."""
    return f"#if !defined(__CUDA_ARCH__){TEXTS['tools']}{body.format(**NUMBERS)}\n#else\n{otherwise}\n#endif\n"


@wp.func_native(team_function_text(JOIN, "return 0;"))
def native_join(team: Team) -> int: ...


@wp.func_native(team_function_text("return rank > 0 ? (int)look({FROM}) : 0;", "return 0;"))
def since(team: Team, rank: int) -> int: ...


@wp.func_native(team_function_text(MEET))
def native_meet(team: Team, rank: int, walkers: int): ...


@wp.func_native(team_function_text(TOGETHER, "return 1;"))
def native_together(team: Team, rank: int, walkers: int, step: int, steps: int) -> int: ...


@wp.func_native(team_function_text(LEAVE))
def native_leave(team: Team, rank: int, walkers: int): ...


# by themselves: they are long, and a kernel calls them from many places


@wp.func(inline=False)
def join(team: Team):
    return native_join(team)


@wp.func(inline=False)
def meet(team: Team, rank: int, walkers: int):
    native_meet(team, rank, walkers)


@wp.func(inline=False)
def together(team: Team, rank: int, walkers: int, step: int, steps: int):
    return native_together(team, rank, walkers, step, steps)


@wp.func(inline=False)
def leave(team: Team, rank: int, walkers: int):
    native_leave(team, rank, walkers)
