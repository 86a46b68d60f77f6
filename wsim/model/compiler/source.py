"""C++ and CUDA that Warp generates, rewritten so that the compiler takes less time for the same bits.

    by reference     Warp hands structs and arrays to functions by value, and some structs have hundreds of fields. What a
                     function only reads is handed over by reference: one that stands by itself (`wp.func(inline=False)`) then
                     costs a call, and no copy. Not where it is given another of that kind to write, which may be the same
                     Such a reference is `__restrict__`: nothing writes the struct, so that places of its arrays are read once,
                     not again behind each store
    parts            A copy of a struct within such a struct, of which fields alone are read, is that struct itself
    gapless          Functions of a struct in GAPLESS find elements of arrays without their gaps and without counting from the
                     end, as Warp allows for: 3 instructions in the place of 10. Trees of joints: a frame of a humanoid takes a
                     CPU 0.73 ms (1.01 before), and a kernel 580 KB of code on a GPU (720 before)
    in place         On a GPU the arguments of a kernel lie in constant memory. A kernel that only reads a struct reads it there
                     (`__grid_constant__`), and the compiler need not remove a copy of it for each call: the substeps of rigid
                     bodies take NVRTC 5.9 CPU-s so, and 14.6 as Warp writes them

    scratch          Arrays of a thread are zeroed twice and copied once by Warp, element by element without a loop. Here a loop
                     zeroes them, and those made by `scratch` (wsim/kernels/math/marks.py), which are written before they are
                     read, nothing does

That is decided function by function from the text alone; what does not look as expected stays as it is. Letting all functions
of 60 statements stand by themselves was tried: fluids compile in a third less time, and their frames take half as long again.
"""

import re
from collections import defaultdict
from functools import partial

from wsim.model.compiler import header
from wsim.model.compiler.core_sharing import share_loops

HEAD = re.compile(r"^static ((?:WP_\w+ )?)([^\n(]+ )(\w+)\(\n((?:    [^\n]*\n)+)\{\n", re.M)
END = "\n}\n"
ONE_LINE = re.compile(r"^(\S.*;)\}$", re.M)          # the body of a native function that ends without a line break
STRUCT = re.compile(r"^struct (\w+)\n?\s*\{", re.M)
ROOM = re.compile(r"^( +)wp::fixedarray_t<(\d+), (.+)> (var_\w+);$", re.M)
MADE = re.compile(r"^( +)(var_\w+) = wp::fixedarray_t<\d+, .+>\(\w+\);$", re.M)
SCRATCH = re.compile(r"^ +// \w+ = scratch\(.*\n(?:.*\n){,2}?" + MADE.pattern[1:], re.M)
ROOMS = """
template <int N, typename T> struct wsim_room : wp::array_t<T> {
    alignas(16) unsigned char bytes[N * sizeof(T)];
    CUDA_CALLABLE inline wsim_room() : wp::array_t<T>(reinterpret_cast<T*>(bytes), N) {}
    CUDA_CALLABLE inline void zero() { for (int i = 0; i < N; ++i) this->data[i] = T(); }
};
"""
GAPLESS = re.compile(r"^    \w+__Trees_\w+ ", re.M)
ELEMENTS = """
template <typename T> CUDA_CALLABLE inline T* wsim_address(const wp::array_t<T>& a, int i) { return a.data + i; }
template <typename T> CUDA_CALLABLE inline void wsim_store(const wp::array_t<T>& a, int i, T x) { a.data[i] = x; }
"""
PART = re.compile(r"^ +(var_\w+) = &(\(\((var_\w+)\)\.\w+\));\n"
                  r" +(var_\w+) = wp::load\(\1\);\n +(var_\w+) = wp::copy\(\4\);\n", re.M)
ONE_INDEX = re.compile(r"\bwp::(address\(var_\w+, -?\w+\);|array_store\(var_\w+, -?\w+, var_\w+\);)")
WRITTEN = re.compile(r"^    (\w+)\* var_\w+", re.M)
PARAMETER = re.compile(r"^    (\w+|wp::array_t<[\w:<>, ]+>) (var_\w+)(?=,$|\)$)", re.M)
KERNEL = re.compile(r'^(extern "C" [^\n]*__global__ void [^\n]*\(\n)((?:    [^\n]*\n)+)\{\n', re.M)
ARGUMENT = re.compile(r"^    (\w+) (var_\w+)(?= = _wp_args->\w+;$)", re.M)
WORD = re.compile(r"\bvar_\w+")
# lines of a function that only reads a struct: the place of a field; the whole as an argument of a function, or a copy; loads
FIELD = re.compile(r"\s*(var_\w+) = &\(+\*?(var_\w+)(?:\)\.|->|\)->)[\w().>-]*;")
CALL = re.compile(r"\s*(?:var_\w+ = )?(?:\w+|wp::copy)\((?:var_\w+|, )+\);")
ELEMENT = re.compile(r"\s*(?:var_\w+ = )?wp::(?:address|array_store|atomic_\w+)\(var_\w+(?:, -?[\w.]+)*\);")   # of an array
GIVEN = re.compile(r"    \w+ (var_\w+) = _wp_args->\w+;")
LOAD = re.compile(r"\s*var_\w+ = wp::load\((var_\w+)\);|\s*[\w:<>, ]+\* (var_\w+);")


def rewrite_functions(text: str) -> str:
    """The source of a module with its functions, and the kernels of a GPU, rewritten."""
    structs = {name for name in STRUCT.findall(text) if not name.startswith("wp_args")}
    text = _rewrite_thread_arrays(ONE_LINE.sub(r"\1\n}", text))
    text = KERNEL.sub(partial(_rewrite_kernel_head, text, structs), text)
    parts, at = [], 0
    for head in HEAD.finditer(text):
        end = text.find(END, head.end() - 1) + 1
        if head.start() < at or not end or head[3].startswith("adj_"):
            continue
        parts += [text[at:head.start()], _rewrite_function(head, text[head.end():end], structs)]
        at = end
    text = share_loops("".join([*parts, text[at:]]), header.INCLUDES)
    return text.replace(header.INCLUDES, header.INCLUDES + ELEMENTS, 1) if "wsim_address(" in text else text


def _rewrite_thread_arrays(text: str) -> str:
    """A module whose arrays of a thread are `ROOMS`, unless something else is done with them than Warp's own forms."""
    names = [found[4] for found in ROOM.finditer(text)]
    if not names or text.count("fixedarray_t<") != len(names) + len(MADE.findall(text)) or header.INCLUDES not in text:
        return text
    text = SCRATCH.sub("", text)
    text = MADE.sub(r"\1\2.zero();", text)
    text = ROOM.sub(r"\1wsim_room<\2, \3> \4;", text)
    return text.replace(header.INCLUDES, header.INCLUDES + ROOMS, 1)


def _rewrite_function(head: re.Match, body: str, structs: set[str]) -> str:
    """A function, or a kernel, whose arguments come by a pointer."""
    word, kind, name, parameters = head.groups()
    kernel = "_wp_args" in parameters
    named = ARGUMENT.findall(body) if kernel else PARAMETER.findall(parameters)
    written = set(WRITTEN.findall(parameters))
    read = only_read(body, {var for of, var in named if of in structs - written or of.startswith("wp::")})

    def by_reference(found: re.Match) -> str:
        return f"    {found[1]} & __restrict__ {found[2]}" if found[2] in read else found[0]
    if kernel:
        body = ARGUMENT.sub(by_reference, body)
    else:
        parameters = PARAMETER.sub(by_reference, parameters)
    body = _rewrite_parts(body, read)
    if GAPLESS.search(parameters):
        body = ONE_INDEX.sub(lambda call: f"wsim_{call[1].removeprefix('array_')}", body)
    return f"static {word}{kind}{name}(\n{parameters}{{\n{body}"


def _rewrite_parts(body: str, read: set[str]) -> str:
    """A body without copies of structs that are parts of those it only reads, of which it only reads fields."""
    for part, place, whole, _, copy in {found.groups() for found in PART.finditer(body)}:
        lines = rf"^ +{part} = [^\n]*\n +var_\w+ = wp::load\({part}\);\n +{copy} = [^\n]*\n"
        without = re.sub(lines, "", re.sub(rf"^ +\w+ {copy};\n", "", body, flags=re.M), flags=re.M)
        fields = len(re.findall(rf"&\(+{copy}\)\.", without))
        if whole in read and fields == len(re.findall(rf"\b{copy}\b", without)) and only_read(without, {copy}):
            body = without.replace(f"({copy}).", f"{place}.")
    return body


def _rewrite_kernel_head(text: str, structs: set[str], head: re.Match) -> str:
    """The head of a kernel of a GPU: structs that it only reads stay where they are given."""
    start, parameters = head.groups()
    given = [(of, name) for of, name in PARAMETER.findall(parameters) if of in structs]
    read = only_read(text[head.end():text.find(END, head.end() - 1)], {name for _, name in given})

    def in_place(found: re.Match) -> str:
        return f"    const __grid_constant__ {found[1]} given_{found[2]}" if found[2] in read else found[0]
    named = "".join(f"    {of} & {name} = const_cast<{of} &>(given_{name});\n" for of, name in given if name in read)
    return f"{start}{PARAMETER.sub(in_place, parameters)}{{\n{named}"


def only_read(body: str, names: set[str]) -> set[str]:
    """Those variables, structs, that a body only reads: fields by loads, the whole as arguments of functions and of copies."""
    if not names:
        return names
    lines = defaultdict(list)
    for line in body.splitlines():
        if not line.lstrip().startswith("//"):
            for word in set(WORD.findall(line)):
                lines[word].append(line)
    return {name for name in names if _is_only_read(name, lines, CALL, GIVEN, ELEMENT)}


def _is_only_read(name: str, lines: dict[str, list[str]], *allowed: re.Pattern) -> bool:
    """Also through the pointers to its fields, and to theirs."""
    for line in lines[name]:
        field = FIELD.fullmatch(line)
        if field and field[2] == name:
            if not _is_only_read(field[1], lines, LOAD):
                return False
        elif not (field and field[1] == name) and not any(form.fullmatch(line) for form in allowed):
            return False
    return True
