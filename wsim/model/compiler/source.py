"""C++ that Warp generates for a CPU, rewritten so that LLVM takes less time for the same bits.

Warp hands structs to functions by value, and LLVM puts functions in wherever they are called (Warp sets its threshold to 9000, 225 is
usual): what is called at three levels is simplified at each, with its copies of structs, some of which have hundreds of fields.

    by reference     a struct that a function only reads is handed over by reference: a function that stands by itself then costs
                     a call, and no copy
    by themselves    functions of LONG statements and more stand by themselves. Rounding does not change: C++ fuses within an
                     expression, and each of Warp's is one operation

Both are decided function by function from the text alone; what does not look as expected stays as it is.
"""

import re

LONG = 60          # statements of a function that stands by itself: 20 compiles as fast, 150 a fifth slower
FUNCTION = re.compile(r"^static ((?:WP_\w+ )?)([^\n(]+ )(\w+)\(\n((?:    [^\n]*\n)+?)\{\n(.*?)^\}\n", re.M | re.S)
STRUCT = re.compile(r"^struct (\w+)\n?\s*\{", re.M)
PARAMETER = re.compile(r"^    (\w+) (var_\w+)(?=[,)])", re.M)
ARGUMENT = re.compile(r"^    (\w+) (var_\w+)(?= = _wp_args->\w+;$)", re.M)
STATEMENT = re.compile(r"^ +[^/\s][^\n]*;$", re.M)
CALL = re.compile(r"\s*(?:var_\w+ = )?(?:\w+|wp::copy)\((?:var_\w+|, )+\);")


def shorter(text: str) -> str:
    """The source of a module, rewritten."""
    structs = {name for name in STRUCT.findall(text) if not name.startswith("wp_args")}

    def rewritten(found: re.Match) -> str:
        word, kind, name, parameters, body = found.groups()
        if name.startswith("adj_"):
            return found[0]
        kernel = "_wp_args" in parameters
        read = _read(body, [var for type_, var in (ARGUMENT.findall(body) if kernel else PARAMETER.findall(parameters))
                            if type_ in structs])
        if kernel:
            body = ARGUMENT.sub(lambda m: f"    {m[1]} & {m[2]}" if m[2] in read else m[0], body)
        else:
            parameters = PARAMETER.sub(lambda m: f"    {m[1]} & {m[2]}" if m[2] in read else m[0], parameters)
            if not word and _statements(body) >= LONG:
                word = "WP_NOINLINE "
        return f"static {word}{kind}{name}(\n{parameters}{{\n{body}}}\n"
    return FUNCTION.sub(rewritten, text)


def _statements(body: str) -> int:
    """Statements that compute something; declarations have no `=` or a constant."""
    return sum(not line.lstrip().startswith("const ") and ("=" in line or "(" in line) for line in STATEMENT.findall(body))


def _read(body: str, names: list[str]) -> set[str]:
    """Those of the structs that are only read: fields by loads, or whole as arguments of functions and of copies."""
    lines = body.splitlines()
    return {name for name in names if _only_read(lines, name)}


def _only_read(lines: list[str], name: str) -> bool:
    """Also through the pointers to its fields, and to theirs."""
    word = re.compile(rf"\b{name}\b")
    field = re.compile(rf"\s*(var_\w+) = &\(+(?:{name})(?:\)\.|->|\)->)[\w().>-]*;")
    for line in lines:
        if not word.search(line):
            continue
        if found := field.fullmatch(line):
            if not _pointer_read(lines, found[1]):
                return False
        elif not CALL.fullmatch(line) and not re.fullmatch(rf"    \w+ {name} = _wp_args->\w+;", line):
            return False
    return True


def _pointer_read(lines: list[str], name: str) -> bool:
    """A pointer that is only loaded from."""
    word, allowed = re.compile(rf"\b{name}\b"), re.compile(
        rf"\s*[\w:<>, ]+\* {name};|\s*{name} = &\([\w().>-]*;|\s*var_\w+ = wp::load\({name}\);")
    deeper = re.compile(rf"\s*(var_\w+) = &\(+\*?{name}(?:\)\.|->|\)->)[\w().>-]*;")
    for line in lines:
        if word.search(line) and not allowed.fullmatch(line):
            found = deeper.fullmatch(line)
            if not found or not _pointer_read(lines, found[1]):
                return False
    return True
