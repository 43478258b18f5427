"""Number of draws of a test, and bounds that follow from it; as test_size.hpp."""
import math
import os
import unittest

FALSE_ALARM = 1e-5  # probability with which a bound of this file refuses a sound program
FULL_SIZE_ONLY = "runs with HELIX_ARM_TEST_SIZE=all, as scripts/test --all sets it"


def is_full_size():
    size = os.environ.get("HELIX_ARM_TEST_SIZE", "default")
    if size not in ("all", "default"):
        raise ValueError("HELIX_ARM_TEST_SIZE is %s; expected all or default" % size)
    return size == "all"


# Of a class or a method of tests that runs in full size alone.
full_size_only = unittest.skipUnless(is_full_size(), FULL_SIZE_ONLY)


def draws(by_default, full):
    return full if is_full_size() else by_default


def most_of(n, p):
    """Largest count to be expected among n independent draws that are true with probability p each, 0 < p < 1."""
    below = 0.0
    for k in range(n):
        below += math.comb(n, k) * p**k * (1 - p)**(n - k)
        if 1 - below <= FALSE_ALARM:
            return k
    return n


def least_of(n, p):
    """Smallest count to be expected, likewise."""
    return n - most_of(n, 1 - p)
