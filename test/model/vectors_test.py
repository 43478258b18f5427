"""Each loop of the batch computes with vectors of two numbers on arm64.

usage: vectors_test.py OBJDUMP LIBRARY

The compiler writes a loop up to three times: with vectors, for the numbers left over, and for arrays that overlap. So at most two
sums or products of single numbers are there for each of vectors; a loop without vectors adds to the former alone.
"""
import re
import subprocess
import sys

LOOPS = {"setTwists": 1, "moveTips": 1, "moveTipsFar": 1, "moveThrough": 1}
ARITHMETIC = r"\tf(?:n?mul|n?m?add|n?m?sub|ml[as]|cm[a-z]+|div|sqrt)\s+"

code = subprocess.run([sys.argv[1], "-dC", "--no-show-raw-insn", sys.argv[2]], stdout=subprocess.PIPE, check=True).stdout.decode()
found = dict.fromkeys(LOOPS, 0)
for function in re.split(r"\n(?=[0-9a-f]+ <)", code):
    name = re.match(r"[0-9a-f]+ <helix_arm::model::\(anonymous namespace\)::(\w+)\((?!.*@plt)", function)
    if name and name.group(1) in LOOPS:
        vectors, singles = (len(re.findall(ARITHMETIC + one, function)) for one in (r"v\d+\.2d", r"d\d+"))
        if vectors == 0 or singles > 2 * vectors:
            sys.exit("%s: %d instructions on vectors, %d on single numbers; expected half as many at least" % (name.group(1), vectors, singles))
        found[name.group(1)] += 1
if found != LOOPS:
    sys.exit("loops found: %s; expected %s" % (found, LOOPS))
