"""Launches of the kernels of fluids: a block of threads of their own size on CUDA; on the CPU one thread takes a sum."""

import warp as wp

from wsim.model.model import Model

BLOCK = 128              # threads of a block on CUDA
BLOCKS = 2048            # of a sum at most, 16 for each processor of an H200: their parts are summed by one block


class Threads:
    def __init__(self, model: Model):
        self.model, self.cuda = model, model.device.is_cuda
        self.module = model.module_of(BLOCK) if self.cuda else model.module

    def over(self, kernel, count: int, inputs: list, outputs: list) -> None:
        """A thread each."""
        if self.cuda:
            wp.launch(kernel, count, inputs, outputs, device=self.model.device, block_dim=BLOCK)
        else:
            wp.launch(kernel, count, inputs, outputs, device=self.model.device)

    def blocks(self, count: int) -> int:
        """Number of blocks of a sum over `count` rows, which has so many parts."""
        return min(-(-count // BLOCK), BLOCKS) if self.cuda else 1

    def sum(self, kernel, blocks: int, inputs: list, outputs: list) -> None:
        """Launches so many blocks of threads, which go over all rows."""
        if self.cuda:
            wp.launch(kernel, blocks * BLOCK, inputs, outputs, device=self.model.device, block_dim=BLOCK)
        else:
            wp.launch(kernel, blocks, inputs, outputs, device=self.model.device)

    def module_of(self, threads: int) -> str:
        """Module of kernels with so many threads a block on CUDA."""
        return self.model.module_of(threads) if self.cuda else self.module

    def part(self, name: str) -> str:
        """Module of a part of the kernels on CUDA, compiled beside the others: a liquid's take NVRTC 11 s as one module."""
        return self.model.module_of(BLOCK, name) if self.cuda else self.module

    def one(self, kernel, threads: int, inputs: list) -> None:
        """One block of so many threads; on the CPU one thread."""
        if self.cuda:
            wp.launch(kernel, threads, inputs, device=self.model.device, block_dim=threads)
        else:
            wp.launch(kernel, 1, inputs, device=self.model.device)

    def zeros(self, count: int, dtype=None) -> wp.array:
        return wp.zeros(max(count, 1), dtype=self.model.real if dtype is None else dtype, device=self.model.device)
