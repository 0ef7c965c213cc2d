"""Contract tests for implementations of your own: subclass one in a test file and run pytest.

Each seam of the project is a small protocol with one class of tests here. Every implementation in
the package passes the same tests as yours:

    # test_my_robot.py
    from contextlib import nullcontext

    from realitygap.robots import RealClock
    from realitygap.testing import BodyContract

    class TestMyRobot(BodyContract):
        def opened(self):
            return nullcontext((MyRobot("/dev/ttyACM0"), RealClock()))

You override one method, which gives the contract what it tests; nothing here imports pytest.
`pytest.register_assert_rewrite("realitygap.testing")` in your `conftest.py` shows the values of a
failed assertion.
"""

from realitygap.testing.algorithm import AlgorithmContract
from realitygap.testing.body import BodyContract
from realitygap.testing.encoding import EncodingContract
from realitygap.testing.engine import EngineContract
from realitygap.testing.pool import PoolContract
from realitygap.testing.track import TrackContract

__all__ = [
    "AlgorithmContract", "BodyContract", "EncodingContract", "EngineContract", "PoolContract",
    "TrackContract",
]  # fmt: skip
