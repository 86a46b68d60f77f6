"""C++ that Warp generates for a CPU, rewritten so that the compiler takes less time for the same bits.

    by reference     Warp hands structs and arrays to functions by value, and some structs have hundreds of fields. What a
                     function only reads is handed over by reference: one that stands by itself (`wp.func(inline=False)`) then
                     costs a call, and no copy. Not where it is given another of that kind to write, which may be the same

That is decided function by function from the text alone; what does not look as expected stays as it is. Letting all functions
of 60 statements stand by themselves was tried: fluids compile in a third less time, and their frames take half as long again.
"""

import re
from collections import defaultdict

HEAD = re.compile(r"^static ((?:WP_\w+ )?)([^\n(]+ )(\w+)\(\n((?:    [^\n]*\n)+)\{\n", re.M)
END = "\n}\n"
STRUCT = re.compile(r"^struct (\w+)\n?\s*\{", re.M)
WRITTEN = re.compile(r"^    (\w+)\* var_\w+", re.M)
PARAMETER = re.compile(r"^    (\w+|wp::array_t<[\w:<>, ]+>) (var_\w+)(?=,$|\)$)", re.M)
ARGUMENT = re.compile(r"^    (\w+) (var_\w+)(?= = _wp_args->\w+;$)", re.M)
WORD = re.compile(r"\bvar_\w+")
# lines of a function that only reads a struct: the place of a field; the whole as an argument of a function, or a copy; loads
FIELD = re.compile(r"\s*(var_\w+) = &\(+\*?(var_\w+)(?:\)\.|->|\)->)[\w().>-]*;")
CALL = re.compile(r"\s*(?:var_\w+ = )?(?:\w+|wp::copy)\((?:var_\w+|, )+\);")
ELEMENT = re.compile(r"\s*(?:var_\w+ = )?wp::(?:address|array_store|atomic_\w+)\(var_\w+(?:, -?[\w.]+)*\);")   # of an array
GIVEN = re.compile(r"    \w+ (var_\w+) = _wp_args->\w+;")
LOAD = re.compile(r"\s*var_\w+ = wp::load\((var_\w+)\);|\s*[\w:<>, ]+\* (var_\w+);")


def functions(text: str) -> str:
    """The source of a module with its functions rewritten."""
    structs = {name for name in STRUCT.findall(text) if not name.startswith("wp_args")}
    parts, at = [], 0
    for head in HEAD.finditer(text):
        end = text.find(END, head.end() - 1) + 1
        if head.start() < at or not end or head[3].startswith("adj_"):
            continue
        parts += [text[at:head.start()], _function(head, text[head.end():end], structs)]
        at = end
    return "".join([*parts, text[at:]])


def _function(head: re.Match, body: str, structs: set[str]) -> str:
    """A function, or a kernel, whose arguments come by a pointer."""
    word, kind, name, parameters = head.groups()
    kernel = "_wp_args" in parameters
    named = ARGUMENT.findall(body) if kernel else PARAMETER.findall(parameters)
    written = set(WRITTEN.findall(parameters))
    read = only_read(body, {var for of, var in named if of in structs - written or of.startswith("wp::")})

    def by_reference(found: re.Match) -> str:
        return f"    {found[1]} & {found[2]}" if found[2] in read else found[0]
    if kernel:
        body = ARGUMENT.sub(by_reference, body)
    else:
        parameters = PARAMETER.sub(by_reference, parameters)
    return f"static {word}{kind}{name}(\n{parameters}{{\n{body}"


def only_read(body: str, names: set[str]) -> set[str]:
    """Those variables, structs, that a body only reads: fields by loads, the whole as arguments of functions and of copies."""
    if not names:
        return names
    lines = defaultdict(list)
    for line in body.splitlines():
        if not line.lstrip().startswith("//"):
            for word in set(WORD.findall(line)):
                lines[word].append(line)
    return {name for name in names if _read(name, lines, CALL, GIVEN, ELEMENT)}


def _read(name: str, lines: dict[str, list[str]], *allowed: re.Pattern) -> bool:
    """Also through the pointers to its fields, and to theirs."""
    for line in lines[name]:
        field = FIELD.fullmatch(line)
        if field and field[2] == name:
            if not _read(field[1], lines, LOAD):
                return False
        elif not (field and field[1] == name) and not any(form.fullmatch(line) for form in allowed):
            return False
    return True
