"""What every encoding does, whatever its genes are."""

import numpy as np

from realitygap.control.encoding import Encoding, controller_of
from realitygap.control.network import check_networks
from realitygap.kernels.params import Networks
from realitygap.simulation.simulation import Simulation

__all__ = ["EncodingContract"]

STREAMS = [np.uint64(k) for k in range(1, 9)]


class EncodingContract:
    """Tests of an encoding: override `made`.

    Example:
        class TestMyEncoding(EncodingContract):
            def made(self, inputs):
                return MyEncoding(inputs=inputs)
    """

    def made(self, inputs: int) -> Encoding:
        """The encoding of networks with `inputs` inputs."""
        raise NotImplementedError("override made()")

    def test_genotypes_are_of_its_type_and_shape(self) -> None:
        """As it says, and the same for the same stream."""
        encoding = self.made(8)
        for stream in STREAMS:
            genes = encoding.random(stream)
            assert genes.dtype == np.dtype(encoding.dtype) and genes.shape == encoding.shape
            assert np.array_equal(genes, encoding.random(stream))

    def test_streams_differ(self) -> None:
        """Not every random genotype is the same."""
        encoding = self.made(8)
        assert len({encoding.random(stream).tobytes() for stream in STREAMS}) > 1

    def test_networks_can_be_carried_out(self) -> None:
        """Genotypes become networks of the task's number of inputs, in the ranges of §5.3."""
        for inputs in (2, 8):
            encoding = self.made(inputs)
            genes = np.stack([encoding.random(stream) for stream in STREAMS])
            assert check_networks(encoding.decode(genes), inputs) == len(genes)

    def test_a_genotype_decodes_alone_as_among_others(self) -> None:
        """Row k of a batch is the network of genotype k, and decoding changes no gene."""
        encoding = self.made(8)
        genes = np.stack([encoding.random(stream) for stream in STREAMS])
        kept, together = genes.copy(), encoding.decode(genes)
        for k, one in enumerate(genes):
            alone = encoding.decode(one[np.newaxis])
            for name in Networks._fields:
                assert np.array_equal(getattr(alone, name)[0], getattr(together, name)[k])
        assert np.array_equal(genes, kept)

    def test_a_body_is_driven_as_in_simulation(self) -> None:
        """On the same inputs the robot's controller decides as the simulated network did."""
        encoding = self.made(8)
        simulation = Simulation("obstacle-avoidance", "paper")
        for stream in STREAMS[:4]:
            genes = encoding.random(stream)
            lived, _ = simulation.trajectory(encoding.decode(genes[np.newaxis]), stream=int(stream))
            controller = controller_of(encoding, genes)
            decided = [controller.decide(fed) for fed in lived.inputs.tolist()]
            assert [[one.left, one.right] for one in decided] == lived.commands.tolist()
