"""The slow, obvious network: a dictionary of neurons and the whole past (§5.2, §5.3).

Written from the readings' text alone, it judges `NetworkController` and the compiled kernel.
A genotype row is: expressed, threshold, then for each link field expressed, source, weight, delay.
"""

from __future__ import annotations

from collections.abc import Sequence


class ReferenceNetwork:
    """y_i(t + 1) = clip(Σ w·y_source(t − delay) − threshold, −10, 10), ten times a step."""

    def __init__(self, genes, inputs: int = 8) -> None:
        rows = [[int(value) for value in row] for row in genes]
        self.inputs = inputs
        self.neurons = {}
        for slot, row in enumerate(rows):
            if slot < inputs or row[0] == 0:
                continue
            links = [row[at : at + 4] for at in range(2, len(row), 4)]
            live = [(src, w, delay) for on, src, w, delay in links if on and rows[src][0]]
            self.neurons[slot] = (row[1], live)
        self.reset()

    def reset(self) -> None:
        """Nothing has happened yet; what happened before was 0."""
        self.past: dict[tuple[int, int], int] = {}
        self.steps = 0

    def output(self, slot: int, t: int) -> int:
        """What slot `slot` put out at update `t`."""
        return self.past.get((slot, t), 0)

    def decide(self, inputs: Sequence[int]) -> tuple[int, int]:
        """(left, right) after this step's ten updates."""
        start = 10 * self.steps
        for t in range(start, start + 10):
            for slot in range(self.inputs):
                self.past[slot, t] = int(inputs[slot])
        for t in range(start, start + 10):
            for slot, (threshold, links) in self.neurons.items():
                total = -threshold
                for source, weight, delay in links:
                    total += weight * self.output(source, t - delay)
                self.past[slot, t + 1] = min(10, max(-10, total))
        self.steps += 1
        end = start + 10
        return self.output(self.inputs, end), self.output(self.inputs + 1, end)

    def drive(self, steps) -> list[tuple[int, int]]:
        """The commands of a whole sequence of inputs, from silence."""
        self.reset()
        return [self.decide(inputs) for inputs in steps]
