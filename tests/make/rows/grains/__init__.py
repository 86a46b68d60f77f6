"""A method that is no part of wsim: grains that fall, keep apart from each other, and lie on what there is. Colliders
are wsim's: `build.colliders`, and five lines of the kernel."""

from wsim.scene.methods import MethodRow

ROW = MethodRow("loose_grains", "tests.make.rows.grains", owns=("Grains",), without="there are no grains")
