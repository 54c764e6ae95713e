"""How many threads a process uses."""

import torch
from threadpoolctl import threadpool_limits


def use_threads(count: int) -> None:
    """Limit torch's threads and those of numpy's and scipy's linear algebra, for the rest of the process.

    The matrices of this field are small: more threads only wait for each other, and take cores from other jobs.

    Args:
        count: Threads, 1 or more.
    """
    torch.set_num_threads(count)
    threadpool_limits(count, user_api="blas")
