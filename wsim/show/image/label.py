"""Text on images: letters of three by five dots, as large as the image allows. NumPy only."""

import numpy as np

# rows of three dots from above, an octal digit each
GLYPHS = {"0": "75557", "1": "26227", "2": "71747", "3": "71717", "4": "55711", "5": "74717", "6": "74757", "7": "71111",
          "8": "75757", "9": "75717", "A": "25755", "B": "65656", "C": "34443", "D": "65556", "E": "74647", "F": "74644",
          "G": "34553", "H": "55755", "I": "72227", "J": "11152", "K": "55655", "L": "44447", "M": "57755", "N": "65555",
          "O": "25552", "P": "65644", "Q": "25563", "R": "65655", "S": "34216", "T": "72222", "U": "55557", "V": "55552",
          "W": "55775", "X": "55255", "Y": "55222", "Z": "71247", ".": "00002", "-": "00700", "+": "02720", "=": "07070",
          "/": "11244", ":": "02020", "_": "00007", ",": "00024", "(": "12221", ")": "42224", "%": "51245", " ": "00000"}
HIGH, DARK = 0.05, 0.45            # height of a letter over that of the image; what is left of the light behind it


def rasterize_text(text: str) -> np.ndarray:
    """Dots of a line of text, (7, 4 n + 1) bool, with a margin of one; a letter without a glyph is a space."""
    dots = np.zeros((7, 4 * len(text) + 1), bool)
    for k, letter in enumerate(text.upper()):
        rows = GLYPHS.get(letter, GLYPHS[" "])
        dots[1:6, 4 * k + 1:4 * k + 4] = [[int(row) >> shift & 1 for shift in (2, 1, 0)] for row in rows]
    return dots


def label_image(image: np.ndarray, lines: list[str]) -> np.ndarray:
    """A copy of an image, uint8 (h, w, 3), with lines of white text on a dark ground at its lower left; too long ones are
    cut."""
    out, lines = image.copy(), [line for line in lines if line]
    if not lines:
        return out
    h, w, _ = image.shape
    longest = max(len(line) for line in lines)
    dot = max(1, min(round(HIGH * h / 5.0), w // (4 * longest + 1), h // (7 * len(lines))))
    dots = np.concatenate([rasterize_text(line.ljust(longest)) for line in lines]).repeat(dot, axis=0).repeat(dot, axis=1)
    dots = dots[:h, :w]
    part = out[h - dots.shape[0]:, :dots.shape[1]]
    part[:] = np.where(dots[..., None], 255, (DARK * part).astype(np.uint8))
    return out
