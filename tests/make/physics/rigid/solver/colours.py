"""What tests/physics/rigid/solver/test_colours.py shares with other tests: check_colours, heap."""

import numpy as np

from tests.make.physics.rigid.contact import box


def heap(n: int = 40) -> list:
    rng = np.random.default_rng(3)
    return [box(f"/box{k}", (*rng.uniform(-1.2, 1.2, 1), 0.6 + 0.35 * k, *rng.uniform(-1.2, 1.2, 1))) for k in range(n)]


def check_colours(sim) -> int:
    """The number of colours of a list in which no two manifolds of one colour share a body."""
    contacts = sim.plan.method("rigid").contacts
    c, work, n = contacts.list, contacts.work, len(sim.plan.method("rigid").bodies)
    count, colour = c.count.numpy(), c.colour.numpy()
    used = np.flatnonzero((count > 0) & (c.a.numpy() >= 0))
    assert len(used) and (colour[used] >= 0).all()
    frame = contacts.table.frame.numpy()
    pairs = frame[np.stack([c.a.numpy()[used], c.b.numpy()[used]], 1)]
    seen = [(k, body) for k, pair in zip(colour[used], pairs, strict=True) for body in pair if body < n]
    assert len(seen) == len(set(seen))
    starts, order, colours = work.starts.numpy(), work.order.numpy(), int(work.colours.numpy()[0])
    assert starts[colours] == len(used) and sorted(order[:len(used)]) == used.tolist()
    for k in range(colours):
        assert (colour[order[starts[k]:starts[k + 1]]] == k).all()
    return colours
