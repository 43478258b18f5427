#!/bin/bash
# After the workspace is sourced, every shell and program finds helix_arm, and none of the nodes, and bash completes its
# subcommands, options, values and files.
# usage: completion_test.sh SETUP.BASH
set -eo pipefail
setup="$1"
scratch="$(mktemp -d)"
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
touch mine.yaml notes.txt "my arm.yaml"
mkdir rigs
PATH=/usr/bin:/bin
# shellcheck disable=SC1090
source "$setup"

faults=0
fault() { echo "$*"; faults=1; }

# complete_words WORD...: completions of the last word are then in COMPREPLY
complete_words() {
  COMP_WORDS=("$@")
  COMP_CWORD=$(($# - 1))
  COMPREPLY=()
  _helix_arm || true  # compopt fails outside of readline
}

# expect WORD... : COMPLETION...: the last word completes to these, among others
expect() {
  local -a words=()
  while [[ $1 != : ]]; do words+=("$1"); shift; done
  shift
  complete_words "${words[@]}"
  local one
  for one in "$@"; do
    [[ " ${COMPREPLY[*]} " == *" $one "* ]] || fault "${words[*]}: $one is not among: ${COMPREPLY[*]}"
  done
}

# expect_all WORD... : COMPLETION...: to these alone
expect_all() {
  expect "$@"
  while [[ $1 != : ]]; do shift; done
  shift
  ((${#COMPREPLY[@]} == $#)) || fault "${COMP_WORDS[*]}: expected $# completions: ${COMPREPLY[*]}"
}

# Found as a program, by what bash's functions do not reach.
timeout 10 helix_arm --version >/dev/null || fault "timeout does not find helix_arm"
xargs -n1 helix_arm <<<--version >/dev/null || fault "xargs does not find helix_arm"
bash -c "helix_arm --version" >/dev/null || fault "bash -c does not find helix_arm"
sh -c ". \"${setup%.bash}.sh\" && helix_arm --version" >/dev/null || fault "sh does not find helix_arm"
rosrun helix_arm helix_arm --version </dev/null >/dev/null || fault "rosrun does not find one helix_arm"
for node in vision monitor; do
  ! type -P "$node" >/dev/null || fault "$node is on PATH"
done

complete -p helix_arm | grep -q _helix_arm
expect helix_arm "" : forward inverse simulate calibrate
expect_all helix_arm fo : forward follow
expect_all helix_arm xyz :
expect_all helix_arm forward --pre : --pressure-kpa
expect helix_arm inverse demo --fo : --format
# subcommands of subcommands
expect_all helix_arm camera "" : calibrate place
expect helix_arm regulator demo set -- : --pressure-kpa --yes
# scenes and their files; what bash gives of a word with a quote or a backslash is raw
expect helix_arm forward "" : demo mine.yaml rigs
expect_all helix_arm forward '"my arm.y' : "my arm.yaml"
expect_all helix_arm forward 'my\ a' : "my arm.yaml"
expect helix_arm follow demo --rig dem : demo
expect_all helix_arm forward demo --inputs no :  # left to readline, which completes files
# values, also as bash splits --format=c
expect_all helix_arm --format "" : text json csv
expect_all helix_arm forward demo --format = c : csv
expect_all helix_arm calibrate demo c.csv --fit stiffness,pla : stiffness,placement
# --board is a flag that may have a value
expect helix_arm tags --board "" : tags charuco demo mine.yaml
expect helix_arm tags --board charuco --sq : --squares --square-size-m
# each option of the help of each subcommand
mapfile -t subcommands < <(helix_arm --help | sed -n -E '/^Subcommands:/,$ s/^  ([a-z]+) .*/\1/p')
((${#subcommands[@]} >= 16)) || fault "subcommands: ${subcommands[*]}"
[[ ${HELIX_ARM_TEST_SIZE:-default} == all ]] || subcommands=(forward)
for subcommand in "${subcommands[@]}"; do
  while read -r option; do
    expect helix_arm "$subcommand" "$option" : "$option"
  done < <(helix_arm "$subcommand" --help | sed -n -E 's/^ +(-[a-z],)?(--[a-z-]+).*/\2/p')
done
exit $faults
