"""Source that is rewritten before it is compiled: what is read alone goes by reference, and adjoints are left out."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from warp._src import build

from wsim.kernels.math.marks import scratch
from wsim.model import kernel_cache
from wsim.model.compiler import header, source, variants

FUNCTION = "static void work_0_cpu_kernel_forward(\n    wp::launch_bounds_t<1> dim)\n{\n}\n"


@wp.struct
class Pair:
    a: wp.array(dtype=float)
    b: float


@wp.struct
class Both:
    pair: Pair
    count: int


@wp.func
def read(both: Both, i: int):
    return both.pair.a[i] * both.pair.b


@wp.func(inline=False)
def changed(pair: Pair, i: int):
    pair.b = pair.b + 1.0
    return pair.a[i] * pair.b


@wp.func(inline=False)
def replaced(pair: Pair, other: Pair, i: int):
    if i > 0:
        pair = other
    return pair.b


@wp.func(inline=False)
def bumped(pair: Pair, same: wp.ref[Pair]):
    same.b = same.b + 1.0
    return pair.b


@wp.func
def own_part(both: Both):
    pair = both.pair
    pair.b = pair.b + 1.0
    return pair.b * both.pair.b


@wp.func
def read_part(both: Both, i: int):
    pair = both.pair
    return pair.a[i] + pair.b


@wp.func
def written(values: wp.array(dtype=float), i: int, x: float):
    values[i] = x


@wp.func
def cubed(x: float):
    return x * x * x


@wp.kernel(module="compiled_source", enable_backward=False)
def work(both: Both, out: wp.array(dtype=float), parts: wp.array(dtype=float)):
    i = wp.tid()
    pair = both.pair
    other = both.pair
    other.b = 100.0
    first = changed(pair, i)
    second = changed(pair, i)
    twice = both.pair
    kept = bumped(twice, twice)
    if kept != 2.0 or twice.b != 3.0:
        first = 0.0
    written(out, i, read(both, i) + 10.0 * first + 1000.0 * second + 1.0e6 * replaced(pair, other, i) + pair.b)
    parts[i] = own_part(both) + 100.0 * read_part(both, i)


@wp.kernel(module="compiled_rooms", enable_backward=False)
def roomy(out: wp.array(dtype=float)):
    i = wp.tid()
    zeros = wp.zeros(shape=(3,), dtype=float)
    work = scratch(shape=(300,), dtype=float)
    for k in range(300):
        work[k] = float(k)
    for k in range(i):
        zeros[k] = work[299]
    out[i] = zeros[0] + zeros[1] + zeros[2]


def generated(module: str = "compiled_source") -> str:
    """Source that Warp made of the module for a CPU."""
    kernel_cache.load_kernel_module(module, kernel_cache.warp_device("cpu"))
    folder = Path(wp.config.kernel_cache_dir, wp.get_module(module).get_module_identifier(1))
    (made,) = folder.glob("*.cpp")
    return made.read_text()


def parameters(text: str, function: str) -> str:
    return re.search(rf"^static [^\n(]*\b\w*{function}_\d\(\n((?:    [^\n]*\n)+?)\{{", text, re.M)[1]


def body_of(text: str, function: str) -> str:
    start = re.search(rf"^static [^\n(]*\b\w*{function}_\d\(\n", text, re.M).end()
    return text[start:text.index("\n}\n", start)]


def test_what_a_function_changes_is_its_own():
    """The caller's struct stays as it was: 3 = 1 * 2 + 1 in both calls, and b is 2 behind them."""
    both = Both()
    both.pair.a, both.pair.b, both.count = wp.array([1.0, 2.0], dtype=float, device="cpu"), 2.0, 7
    out, parts = (wp.zeros(2, dtype=float, device="cpu") for _ in range(2))
    kernel_cache.load_kernel_module("compiled_source", kernel_cache.warp_device("cpu"))
    wp.launch(work, 2, [both], [out, parts], device="cpu")
    a = np.array([1.0, 2.0])
    assert out.numpy() == pytest.approx(2.0 * a + 1010.0 * 3.0 * a + 1.0e6 * np.array([2.0, 100.0]) + 2.0, rel=1e-6)
    assert parts.numpy() == pytest.approx(6.0 + 100.0 * (a + 2.0), rel=1e-6)


def test_a_part_that_is_only_read_is_not_copied():
    text = source.rewrite_functions(generated())
    assert "wp::copy" not in body_of(text, "read_part") and "wp::copy" in body_of(text, "own_part")


def test_elements_of_trees_are_found_without_gaps_and_others_as_warp_does():
    text = generated()
    assert "wsim_address" not in source.rewrite_functions(text)
    trees = source.rewrite_functions(text.replace("Pair_", "struct__Trees_"))
    assert "wsim_address(" in body_of(trees, "changed") and "wsim_address(" not in body_of(trees, "read")
    assert trees.index("T* wsim_address(") < trees.index(" changed_0(")


def test_what_is_only_read_goes_by_reference_and_nothing_else():
    text = source.rewrite_functions(generated())
    assert " & __restrict__ var_both" in parameters(text, "read")
    assert " & __restrict__ var_values" in parameters(text, "written")
    assert " & " not in parameters(text, "changed")
    assert " var_pair" in parameters(text, "replaced") and " & __restrict__ var_pair" not in parameters(text, "replaced")
    assert " & __restrict__ var_pair" not in parameters(text, "bumped")


def test_a_native_function_of_one_line_does_not_hide_the_next():
    """Its body ends without a line break, as Warp writes a snippet that has none."""
    text = generated()
    before = next(head.start() for head in source.HEAD.finditer(text) if head[3] == "read_0")
    native = "static CUDA_CALLABLE void native_0(\n    wp::int32 i)\n{\na.data[i] = 0;}\n\n\n"
    assert " & __restrict__ var_both" in parameters(source.rewrite_functions(text[:before] + native + text[before:]), "read")


KERNEL = """struct Pair_1
{
    wp::array_t<wp::float32> a;
};

extern "C" __launch_bounds__(256) __global__ void work_cuda_kernel_forward(
    wp::launch_bounds_t<1> dim,
    Pair_1 var_pair,
    Pair_1 var_other)
{
    var_1 = &((var_pair).a);
    var_2 = wp::load(var_1);
    %s
}
"""


@pytest.mark.parametrize("line, stays", [("taken_0(var_other);", True), ("var_other = var_pair;", False)])
def test_a_kernel_of_a_gpu_reads_in_place_the_structs_that_it_does_not_change(line, stays):
    text = source.rewrite_functions(KERNEL % line)
    assert ("const __grid_constant__ Pair_1 given_var_other" in text) == stays
    assert ("Pair_1 & var_other = const_cast<Pair_1 &>(given_var_other);" in text) == stays
    assert (text.count("__grid_constant__") == 2) == stays


@pytest.mark.skipif(sys.platform == "darwin", reason="Warp has no NVRTC there")
def test_a_gpu_compiles_what_is_rewritten(monkeypatch, tmp_path):
    """NVRTC takes it without a device, and not for want of that as it was."""
    monkeypatch.setattr(variants, "TOLD", [])
    seen = []
    real = source.rewrite_functions
    monkeypatch.setattr(source, "rewrite_functions", lambda text: seen.append(real(text)) or seen[-1])
    for name in ("compiled_source", "compiled_rooms"):
        with variants.single_variant(cpu=False):
            wp.compile_aot_module(wp.get_module(name), arch=90, module_dir=tmp_path)
    assert not variants.TOLD and "const __grid_constant__ Both" in seen[0] and "wsim_room<300" in seen[1]


def test_arrays_of_a_thread_are_zeroed_once_and_scratch_never():
    text = source.rewrite_functions(generated("compiled_rooms"))
    assert text.count("var_") and "fixedarray_t" not in text.partition("builtin_tid1d")[2]
    assert len(re.findall(r"wsim_room<\d+, wp::float32> var_\w+;", text)) == 2 and text.count(".zero();") == 1


def test_a_module_without_a_backward_pass_has_a_header_without_adjoints():
    text = generated()
    assert header.INCLUDES in text
    short = header.with_lean_header(text)
    assert "#include" not in short.partition("builtin_tid1d")[2] and header.INCLUDES not in short
    whole = "".join(path.read_text() for path in header.NATIVE.glob("*.h"))
    left, all_ = (re.findall(r"\bvoid adj_(?!atomic|tile)\w+\(", each) for each in (header.lean_header_text(), whole))
    assert len(all_) > 300 and len(left) < 0.01 * len(all_)


def test_the_header_is_enough_for_what_a_module_calls(monkeypatch, tmp_path):
    """It compiles as rewritten, and not for want of that as it was; meshes, volumes, textures, noise and tiles are in it."""
    given, tried = tmp_path / "module.cpp", []
    given.write_text(generated())
    monkeypatch.setattr(header, "KEPT", False)

    def counted(*args, **more):
        tried.append(args[1])
        build.build_cpu(*args, **more)
    variants.compile_rewritten(counted, str(tmp_path / "module.o"), str(given), block_dim=1)
    assert len(tried) == 1 and tried[0] != str(given)
    assert all(re.search(rf"\b{name}\(", header.lean_header_text()) for name in (
        "mesh_query_point", "volume_sample_f", "texture_sample", "curlnoise", "tile_matmul", "hash_grid_query"))


def test_the_header_keeps_all_functions_but_adjoints():
    whole = "".join(path.read_text() for path in header.NATIVE.glob("*.h") if path.name in ("vec.h", "mat.h", "quat.h"))
    names = set(re.findall(r"^inline CUDA_CALLABLE [^\n]*?(\w+)\(", whole, re.M)) - set(re.findall(r"\badj_\w+", whole))
    assert len(names) > 40 and all(re.search(rf"\b{name}\(", header.lean_header_text()) for name in names)


def test_a_process_that_keeps_headers_has_one_without_adjoints_and_compiles_the_same_code_by_it(monkeypatch, tmp_path):
    """Made by the first module, and read by the second."""
    given, place = tmp_path / "module.cpp", tmp_path / "headers"
    given.write_text(generated())
    place.mkdir()
    compiled, made, binary = [], [], tmp_path / "module.o"
    for kept in (False, True, True):
        monkeypatch.setattr(header, "KEPT", kept)
        variants.compile_rewritten(build.build_cpu, str(binary), str(given), use_precompiled_headers=True, pch_dir=str(place),
                                   block_dim=1)
        compiled.append(binary.read_bytes())
        made.append({path: path.stat().st_mtime_ns for path in place.rglob("*.pch")})
    assert compiled[0] == compiled[1] == compiled[2]
    assert made[0] == {} and len(made[1]) == 1 and made[1] == made[2]
    (folder,) = place.iterdir()
    assert folder.name == "lean" and "adj_add(" not in (folder / "builtin.h").read_text()


@wp.kernel(module="compiled_graded", enable_backward=False)
def slope(x: float, out: wp.array(dtype=float)):
    out[0] = wp.grad(cubed)(x)


def test_a_module_that_calls_adjoints_keeps_the_whole_header(tmp_path):
    """Though it has no backward pass: d(x^3)/dx = 12 where x is 2."""
    out, given, seen = wp.zeros(1, dtype=float, device="cpu"), tmp_path / "module.cpp", []
    given.write_text(generated("compiled_graded"))
    wp.launch(slope, 1, [2.0], [out], device="cpu")
    variants.compile_rewritten(lambda obj, cpp, **more: seen.append(Path(cpp).read_text()), "module.o", str(given))
    assert out.numpy()[0] == 12.0 and len(seen) == 1 and header.INCLUDES in seen[0]


@pytest.mark.parametrize("text, fails, said", [
    (f"{header.INCLUDES}{FUNCTION}", True, "does not compile module as wsim rewrites it"),
    (f"{header.INCLUDES}", False, "writes the source of kernels in another form"),
    (FUNCTION, False, "writes the source of kernels in another form")], ids=["fails", "no function", "no header"])
def test_what_cannot_be_rewritten_is_compiled_as_it_was_and_that_is_said_once(monkeypatch, tmp_path, text, fails, said):
    seen = []

    def compiled(obj_path, cpp_path, **more):
        seen.append((cpp_path, more["use_precompiled_headers"]))
        if fails and cpp_path != str(given):
            raise RuntimeError("no")
    given = tmp_path / "module.cpp"
    given.write_text(text)
    monkeypatch.setattr(variants, "TOLD", [])
    with pytest.warns(RuntimeWarning, match=rf"^Warp {wp.__version__} {said}: .* install warp-lang==1\.19") as heard:
        for _ in range(2):
            variants.compile_rewritten(compiled, "module.o", str(given), use_precompiled_headers=True)
    assert len(heard) == 1 and seen[0][0] != str(given)
    assert not fails or seen[1] == (str(given), True)
    assert list(tmp_path.iterdir()) == [given] and given.read_text() == text


def test_a_module_that_does_not_compile_at_all_is_no_fault_of_the_rewriting(monkeypatch, tmp_path):
    def compiled(*args, **more):
        raise RuntimeError("no")
    given = tmp_path / "module.cpp"
    given.write_text(f"{header.INCLUDES}{FUNCTION}")
    monkeypatch.setattr(variants, "TOLD", [])
    with pytest.raises(RuntimeError, match="no"):
        variants.compile_rewritten(compiled, "module.o", str(given))
    assert variants.TOLD == []
