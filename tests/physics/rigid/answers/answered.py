"""Cases of the benchmark of rigid contacts (tools/bench/rigid/answers) as tests: no error is larger than allowed."""

from tools.bench.rigid.answers.__main__ import every
from tools.bench.rigid.answers.case import lines


def check_case(name: str, precision: str = "float32") -> None:
    """Runs a case by name. Its docstring has the answer, its figures what is allowed."""
    (case,) = [c for c in every() if c.name == name]
    figures, cpu = case.run(precision)
    wrong = [f for f in figures if not f.good]
    assert figures and not wrong, "\n" + "\n".join(lines(case, wrong, cpu))
