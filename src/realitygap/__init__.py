"""realitygap: evolve controllers in a calibrated simulation of a Khepera, and measure the gap."""

__version__ = "0.1.0"
