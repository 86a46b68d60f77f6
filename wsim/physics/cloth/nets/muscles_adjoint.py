"""Adjoint of the rest lengths that muscles put (`wsim.physics.cloth.nets.muscles`): kernels/cloth/muscle.py."""

from collections.abc import Callable

import numpy as np
import warp as wp

from wsim.kernels.cloth import muscle as kernels


class SiteAdjoint:
    """The adjoint of one table of springs: sums over the springs of each group, in their order."""

    def __init__(self, site, model, column: np.ndarray, groups: int):
        """site: the table; column: of the factors, for each of its entries."""
        self.site, order = site, np.argsort(column, kind="stable")
        first = np.searchsorted(column[order], np.arange(groups + 1))
        self.item, self.first = model.upload(order.astype(np.int32), int), model.upload(first.astype(np.int32), int)
        self.share = wp.zeros(groups * kernels.LANES, dtype=model.real, device=model.device)
        self.shares, self.release = (kernels.muscle_share_kernel(model.real, model.module),
                                     kernels.muscle_release_kernel(model.real, model.module))

    def hand(self, launch: Callable, factor: wp.array, row: int) -> None:
        """Passes from the gradient of the lengths of a row to those of the factors and of the lengths without muscles."""
        s = self.site
        launch(self.shares, self.share.size, [self.first, self.item, s.rest, s.length.grad], [self.share])
        launch(self.release, s.size, [s.column, factor, self.share, row], [s.length.grad, s.rest.grad, factor.grad])
