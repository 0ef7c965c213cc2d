"""Linear algebra in one thread: with more, a machine's number of cores would decide the last bits, and on
small matrices threads only wait for each other."""

from threadpoolctl import threadpool_limits

__all__ = ["one_thread"]


def one_thread() -> threadpool_limits:
    """For the whole process: from now on, or within a `with` statement."""
    return threadpool_limits(1, user_api="blas")
