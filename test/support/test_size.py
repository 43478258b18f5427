"""Number of draws of a test, as in test_size.hpp."""
import os
import unittest

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
