"""`wsim docs`: the pages of wsim/docs, which are installed with the package."""

from difflib import get_close_matches
from pathlib import Path
from re import IGNORECASE, escape, findall

from wsim.scene import Problem, SceneError

FOLDER = Path(__file__).resolve().parent.parent / "docs"
FIRST = ("start", "concepts")              # the order of a reader; the others by name, LAST at the end
LAST = ("schema", "frame", "extending", "troubleshooting", "limits")


def documentation_pages() -> dict[str, Path]:
    """Files by topic, in the order in which one reads them."""
    found = {path.stem: path for path in sorted(FOLDER.glob("*.md"))}
    names = [*FIRST, *(name for name in found if name not in FIRST + LAST), *LAST]
    return {name: found[name] for name in names}


def pages_with_word(found: dict[str, Path], word: str) -> list[str]:
    """Topics, three at most, whose pages have words that begin so; the one that has most of them, for its length, first."""
    texts = {name: path.read_text(encoding="utf-8") for name, path in found.items() if name not in ("start", *LAST)}
    share = {name: len(findall(rf"\b{escape(word)}", text, IGNORECASE)) / len(text) for name, text in texts.items()}
    return [name for name in sorted(share, key=lambda name: -share[name]) if share[name] > 0.0][:3]


def docs(args) -> int:
    """Lists the topics, or prints a page."""
    found = documentation_pages()
    if args.topic is None:
        for name, path in found.items():
            print(f"{name:{max(map(len, found))}}  {path.read_text(encoding='utf-8').partition(chr(10))[0].lstrip('# ')}")
        print("\nRead one: wsim docs TOPIC. Fields of a class: help(wsim.Cloth) in Python. Attributes in USD: wsim docs schema")
        return 0
    topic = args.topic.replace("-", "_").lower()
    if topic not in found:
        close = get_close_matches(topic, found, 1, 0.85) or pages_with_word(found, topic.replace("_", " "))
        guess = f"did you mean {' or '.join(close)}?" if close else f"there are: {', '.join(found)}"
        raise SceneError(Problem(args.topic, f"no page has this name; {guess}"))
    print(found[topic].read_text(encoding="utf-8"), end="")
    return 0
