"""Real-valued weights: an encoding of your own, and an evolution strategy that searches it.

    realitygap evolve avoidance --set encoding.kind=examples/real_weights.py:Weights \\
        --set evolution.algorithm=examples/real_weights.py:Strategy

A genotype is the matrix of a network in which every sensor and every neuron feeds every neuron.
Networks use whole numbers (§5.3), so weights are rounded when they are decoded.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from realitygap import Genotype
from realitygap.evolution import Batch, Population


@dataclass(frozen=True, kw_only=True)
class Weights:
    """float64[2 + hidden, 1 + inputs + 2 + hidden]: a neuron's threshold / 2.5, then its weights."""

    inputs: int
    hidden: int = 2
    dtype = np.dtype(np.float64)

    @property
    def shape(self) -> tuple[int, int]:
        return 2 + self.hidden, 1 + self.inputs + 2 + self.hidden

    def random(self, stream: np.uint64) -> np.ndarray:
        return np.random.default_rng(int(stream)).normal(0.0, 1.5, self.shape)

    def decode(self, genes: np.ndarray) -> Any:
        """By the same networks as genotypes of slots: a link from everybody to every neuron."""
        neurons, sources = self.shape[0], self.shape[1] - 1
        slots = np.zeros((len(genes), sources, 2 + 4 * sources), np.int8)
        slots[:, :, 0] = 1  # expressed
        slots[:, self.inputs :, 1] = np.rint(np.clip(2.5 * genes[:, :, 0], -10, 10))
        links = np.zeros((len(genes), neurons, sources, 4), np.int8)  # expressed, source, weight, delay
        links[..., 0], links[..., 1] = 1, np.arange(sources)
        links[..., 2] = np.rint(np.clip(genes[:, :, 1:], -4, 4))
        slots[:, self.inputs :, 2:] = links.reshape(len(genes), neurons, -1)
        return Genotype.decode(slots, self.inputs)


@dataclass(frozen=True, kw_only=True)
class Strategy:
    """(μ, λ): λ children about the mean of the best μ, asked for all at once; steps shrink slowly."""

    encoding: Any
    children: int = 12
    parents: int = 3
    step: float = 0.6

    @property
    def cells(self) -> int:
        return self.children

    def init(self, stream: np.uint64) -> Population:
        mean = self.encoding.random(stream)
        return Population.empty(stream, mean, self.children, mean=mean, step=self.step)

    def ask(self, state: Population, n: int) -> Batch:
        told = state.evaluations % self.children  # of this generation
        cells = range(told, min(told + n, self.children))
        names = [[int(state.stream), state.evaluations - told, k] for k in cells]
        noise = np.stack([np.random.default_rng(one).normal(size=self.encoding.shape) for one in names])
        return state.batch(state.memory["mean"] + state.memory["step"] * noise, cells=cells)

    def tell(self, state: Population, batch: Batch, fitness: np.ndarray) -> Population:
        state = state.told(batch, fitness)
        if state.evaluations % self.children:
            return state
        mean = state.genes[np.argsort(-state.fitness, kind="stable")[: self.parents]].mean(axis=0)
        return state.remember(mean=mean, step=0.98 * state.memory["step"])

    def from_bytes(self, data: bytes) -> Population:
        return Population.from_bytes(data)
