"""A method that is no part of wsim and pushes what is: balls that fly without turning, and meet the points of cloth both ways.
Their carrier is theirs (kernel.py); pairs, impulses, friction and growth are wsim's."""

from wsim.scene.methods import Row

ROW = Row("balls", "tests.make.balls", owns=("Ball",), without="there is no ball", pushes=True)
