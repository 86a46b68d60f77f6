"""Launches that several cores of a CPU share: C++ for kernels that are marked so (`kernel_over_cores`, kernels/math/marks.py).

Warp's entry point of a kernel on a CPU is a loop over its threads. Here the loop of a marked kernel becomes a function of a
range of them. Who launches runs a first piece and times it. What is left is then cut into chunks, which it and the helpers
(`CoreTeam`) take one after the other. The launch ends when all are done. So graphs, captures and arguments stay as they are, a
GPU sees nothing of this, and any launch may be run by its own thread alone.

    desk      words of a process, LINE words apart, which cores pass on to each other
    OPEN      number of the job, shifted by 32, and its chunks that nobody has taken: who lowers it by one has the next. A job
              does not end before its chunks, so that whoever gets one has read that job and no other
    DONE      chunks that have been run
    LED       1 while a launch has the desk: launches of other threads run alone meanwhile
    AWAKE     helpers that look for work. They stop after SPIN without any, and sleep in a read from a pipe
    HELPED    chunks that helpers have run

A helper whose core another process has taken holds up the launch with its chunk. After such a wait, launches run alone for
PENANCE times as long. Integers of a marked kernel are added, and their extremes found, by Clang's atomics: Warp's are none on
a CPU. Helpers compute with the rounding mode of who launches.
"""

import re

from wsim.kernels.math.marks import OVER_CORES

LINE = 16              # words of eight bytes from word to word: two cache lines, since processors fetch them in pairs
CORES, PIPE, WRITE, NAP, CLOCK, KIND, QUIT, SHARED, LEAST, LATE = range(10)     # first line, by `CoreTeam`
JOB, OPEN, DONE, LED, AWAKE, ALONE, HELPED = (LINE * line for line in range(1, 8))
WORDS = 8 * LINE
PIECES = 16            # the first piece is a launch over PIECES
CHUNKS = 12            # of a core, at most: 2 % of a launch is then left to wait for on two cores
TIMES = {LEAST: 5_000,          # [ns] of a chunk, at least
         LATE: 150_000,         # [ns] of waiting beyond a chunk's time: a helper's core is taken
         SHARED: 30_000}        # [ns] of a launch from which it is shared with helpers that are awake,
WAKING = 4             # and, times as long, from which they are woken: that takes 5 us, and they come after 30 to 60
SPIN = 200_000         # [ns] that a helper looks for work, and that a launch waits until it naps
PENANCE = 16
SYMBOL, WORK = "wsim_cores", "wsim_cores_work"          # names in a module: the desk's address; what a helper does

TEXT = """
typedef unsigned long long wsim_word;
typedef void (*wsim_range)(void*, void*, wsim_word, wsim_word);
extern "C" {{ wsim_word* {SYMBOL} = nullptr; }}
namespace wp {{
template <> inline int atomic_add(int* a, int value) {{ return __atomic_fetch_add(a, value, __ATOMIC_RELAXED); }}
template <> inline int atomic_max(int* a, int value) {{
    int old = __atomic_load_n(a, __ATOMIC_RELAXED);
    while (old < value && !__atomic_compare_exchange_n(a, &old, value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {{}}
    return old;
}}
template <> inline int atomic_min(int* a, int value) {{
    int old = __atomic_load_n(a, __ATOMIC_RELAXED);
    while (old > value && !__atomic_compare_exchange_n(a, &old, value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {{}}
    return old;
}}
}}
static inline wsim_word wsim_look(wsim_word* word) {{ return __atomic_load_n(word, __ATOMIC_ACQUIRE); }}
static inline void wsim_say(wsim_word* word, wsim_word value) {{ __atomic_store_n(word, value, __ATOMIC_RELEASE); }}
static inline wsim_word wsim_now(wsim_word* desk) {{
    long long t[2];
    ((signed (*)(signed, long long*))desk[{CLOCK}])((signed)desk[{KIND}], t);
    return 1000000000ull * (wsim_word)t[0] + (wsim_word)t[1];
}}
#if defined(__SSE__)
static inline unsigned wsim_rounding() {{ return __builtin_ia32_stmxcsr(); }}
static inline void wsim_round(unsigned how) {{ __builtin_ia32_ldmxcsr(how); }}
static inline void wsim_breathe() {{ __builtin_ia32_pause(); }}
#else
static inline unsigned wsim_rounding() {{ return 0; }}
static inline void wsim_round(unsigned) {{}}
static inline void wsim_breathe() {{}}
#endif
static WP_NOINLINE wsim_word wsim_take(wsim_word* desk) {{
    wsim_word taken = 0;
    wsim_word open = wsim_look(desk + {OPEN});
    while ((unsigned)open > 0) {{
        wsim_word job[7];
        for (int i = 0; i < 7; ++i) job[i] = __atomic_load_n(desk + {JOB} + i, __ATOMIC_RELAXED);
        if (!__atomic_compare_exchange_n(desk + {OPEN}, &open, open - 1, false, __ATOMIC_ACQ_REL, __ATOMIC_ACQUIRE)) continue;
        const wsim_word first = job[3], count = job[4] - first, chunks = job[5], number = chunks - (unsigned)open;
        wsim_round((unsigned)job[6]);
        ((wsim_range)job[0])((void*)job[1], (void*)job[2], first + number * count / chunks,
                             first + (number + 1) * count / chunks);
        __atomic_fetch_add(desk + {DONE}, 1, __ATOMIC_RELEASE);
        ++taken;
        open = wsim_look(desk + {OPEN});
    }}
    return taken;
}}
extern "C" void {WORK}(wsim_word* desk) {{
    const unsigned rounding = wsim_rounding();
    for (wsim_word begun = wsim_now(desk); !wsim_look(desk + {QUIT}) && wsim_now(desk) - begun < {SPIN}ull;) {{
        const wsim_word taken = wsim_take(desk);
        if (taken > 0) {{
            __atomic_fetch_add(desk + {HELPED}, taken, __ATOMIC_RELAXED);
            begun = wsim_now(desk);
        }}
        for (int i = 0; i < 8; ++i) wsim_breathe();
    }}
    wsim_round(rounding);
    __atomic_fetch_sub(desk + {AWAKE}, 1, __ATOMIC_ACQ_REL);
}}
static void wsim_wake(wsim_word* desk) {{
    const char bytes[64] = {{}};
    const long long lacking = (long long)(desk[{CORES}] - 1 - wsim_look(desk + {AWAKE}));
    if (lacking <= 0) return;
    __atomic_fetch_add(desk + {AWAKE}, lacking, __ATOMIC_ACQ_REL);
    auto write = (long long (*)(signed, const void*, wsim_word))desk[{WRITE}];
    const long long woken = write((signed)desk[{PIPE}], bytes, lacking);
    if (woken < lacking) __atomic_fetch_sub(desk + {AWAKE}, lacking - (woken > 0 ? woken : 0), __ATOMIC_ACQ_REL);
}}
static void wsim_wait(wsim_word* desk, wsim_word chunks, wsim_word patience) {{
    if (wsim_look(desk + {DONE}) == chunks) return;
    const wsim_word begun = wsim_now(desk);
    wsim_word now = begun;
    while (wsim_look(desk + {DONE}) != chunks) {{
        if (now - begun > {SPIN}ull) ((signed (*)(unsigned))desk[{NAP}])(20);
        else for (int i = 0; i < 8; ++i) wsim_breathe();
        now = wsim_now(desk);
    }}
    if (now - begun > patience) desk[{ALONE}] = now + {PENANCE}ull * (now - begun);
}}
static WP_NOINLINE void wsim_share(wsim_word count, wsim_range run, void* dim, void* args) {{
    wsim_word* desk = {SYMBOL};
    if (!desk || desk[{CORES}] < 2 || count < {PIECES} || __atomic_exchange_n(desk + {LED}, 1, __ATOMIC_ACQUIRE)) {{
        run(dim, args, 0, count);
        return;
    }}
    const wsim_word begun = wsim_now(desk), first = count / {PIECES};
    run(dim, args, 0, first);
    const wsim_word now = wsim_now(desk), left = (now - begun) * (count - first) / first;
    if (left < desk[{SHARED}] || now < desk[{ALONE}]) run(dim, args, first, count);
    else {{
        wsim_word chunks = desk[{CORES}] * {CHUNKS};
        if (chunks > count - first) chunks = count - first;
        if (chunks > left / desk[{LEAST}] + 1) chunks = left / desk[{LEAST}] + 1;
        const wsim_word job[7] = {{(wsim_word)run, (wsim_word)dim, (wsim_word)args, first, count, chunks, wsim_rounding()}};
        for (int i = 0; i < 7; ++i) __atomic_store_n(desk + {JOB} + i, job[i], __ATOMIC_RELAXED);
        wsim_say(desk + {DONE}, 0);
        wsim_say(desk + {OPEN}, ((desk[{OPEN}] >> 32) + 1) << 32 | chunks);
        if (left > {WAKING} * desk[{SHARED}]) wsim_wake(desk);
        wsim_take(desk);
        wsim_wait(desk, chunks, desk[{LATE}] + 2 * left / chunks);
    }}
    wsim_say(desk + {LED}, 0);
}}
"""
LOOP = re.compile(r"    wp::launch_bounds_t<(\d)> \*dim,\n    wp_args_\w+ \*_wp_args\)\n\{\n"
                  r"    for \(size_t task_index = 0; task_index < dim->size; \+\+task_index\)\n    \{\n"
                  rf"        (\w+{OVER_CORES}\w*)_cpu_kernel_forward<wp_linear_contiguous>\(\*dim, task_index, _wp_args\);\n"
                  r"    \}\n")
SHARE = r"""    wp::launch_bounds_t<\1> *dim,
    wp_args_\2 *_wp_args)
{
    wsim_share(dim->size, [](void* d, void* a, wsim_word begin, wsim_word end) {
        for (size_t task_index = begin; task_index < end; ++task_index)
            \2_cpu_kernel_forward<wp_linear_contiguous>(*(wp::launch_bounds_t<\1>*)d, task_index, (wp_args_\2*)a);
    }, dim, _wp_args);
"""
_NUMBERS = {name: value for name, value in globals().items() if isinstance(value, int)} | {"SYMBOL": SYMBOL, "WORK": WORK}


def share_loops(text: str, includes: str) -> str:
    """The source of a module with the loops of its marked kernels shared; as it is, where it has none. includes: the lines
    behind which that may use Warp's functions."""
    shared, count = LOOP.subn(SHARE, text)
    return shared.replace(includes, includes + TEXT.format(**_NUMBERS), 1) if count and includes in text else text
