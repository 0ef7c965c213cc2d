"""Controllers of your own: a function for obstacle avoidance, a class for light seeking.

    realitygap simulate avoidance --controller examples/own_controller.py:avoid --pose 25,25,90
    realitygap drive light --controller examples/own_controller.py:Homing --robot twin:1 --starts 2

`inputs` are whole numbers from −10 to 10, one for each sensor that the task feeds; of a Khepera's eight, 0
to 2 look left and ahead, 3 to 5 ahead and right, 6 and 7 back. Commands are −10 to 10, too.
"""


def avoid(inputs):
    """Drive straight on; turn away from the side where something is nearer."""
    left, right = max(inputs[0:3]), max(inputs[3:6])
    if max(left, right) < -5:
        return 8, 8
    return (6, -4) if left > right else (-4, 6)


class Homing:
    """Turns to the brighter side, drives straight at a light ahead, else circles the way it last turned."""

    def reset(self):
        """Called before each trial."""
        self.turn = 3

    def decide(self, inputs):
        """Called every step of 0.1 s."""
        left, right = sum(inputs[0:3]), sum(inputs[3:6])
        if abs(left - right) > 2:
            self.turn = 3 if right > left else -3
            return 6 + self.turn, 6 - self.turn
        return (9, 9) if max(inputs[2], inputs[3]) > -5 else (6 + self.turn, 6 - self.turn)
