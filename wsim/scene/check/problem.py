"""Words about what is wrong with a scene, each with the prim path."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Problem:
    """Something wrong with a scene, as in `[problem.text for problem in load("flag.usda").notes]`.

    path        prim path, or the file or option that is at fault
    text        what was found, what is allowed and the cure, in one line
    fatal       True: the scene cannot be simulated; False: a warning
    overlap     True: it is about objects that overlap at the start
    lacks       True: something is missing; not reported if another prim could not be read, which may be the cause
    """

    path: str
    text: str
    fatal: bool = True
    overlap: bool = False
    lacks: bool = False

    def __str__(self) -> str:
        return f"{'error' if self.fatal else 'warning'}: {self.path}: {self.text}".replace("\n", "\\n")


class SceneError(Exception):
    """A scene that cannot be run. `problems` lists everything found, each with its prim path, as in
    `raise SceneError(Problem("/flag", "stretch is -1; allowed is more than 0"))`."""

    def __init__(self, problems):
        self.problems = [problems] if isinstance(problems, Problem) else list(problems)
        super().__init__("\n".join(f"{p.path}: {p.text}".replace("\n", "\\n") for p in self.problems))
