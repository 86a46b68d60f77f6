"""Rest shapes and rest lengths as inputs of a recording. See `wsim.gradient.inputs.by_name`."""

import numpy as np

from wsim.gradient.inputs.base import PART, RecordingInput
from wsim.model.model import edge_lengths
from wsim.physics.cloth.rest_shape import current_rest_shape


class RestInput(RecordingInput):
    """rest_shape of a body, or lengths of a spring net."""

    def read_value(self, world: int = 0) -> np.ndarray:
        body = self.model.body(self.path, world)
        if self.what == "rest_shape":
            return current_rest_shape(body)
        return edge_lengths(body)

    def difference_scale(self) -> float:
        """A part of a mean edge."""
        return 0.2 * PART * float(edge_lengths(self.model.body(self.path)).mean())
