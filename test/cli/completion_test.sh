#!/bin/bash
# After the workspace is sourced, every shell and program finds helix_arm, and none of the nodes, and bash completes its
# subcommands, options, values and files.
# usage: completion_test.sh SETUP.BASH
set -eo pipefail
setup="$1"
scratch="$(mktemp -d)"
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
touch mine.yaml notes.txt "my arm.yaml" "arm's.yaml"
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
expect helix_arm --ver : --version
expect_all helix_arm forward --pre : --pressure-kpa
expect helix_arm inverse scene.yaml --ti : --tip
expect helix_arm inverse demo --fo : --format
# scenes and their files
expect helix_arm forward spat : spatial_50 spatial_101
expect helix_arm forward "" : demo mine.yaml rigs
expect_all helix_arm forward mi : mine.yaml
# as bash gives a word with a quote or a backslash: raw; readline quotes the answer again
expect_all helix_arm forward '"my' : "my arm.yaml"
expect_all helix_arm forward '"my arm.y' : "my arm.yaml"
expect_all helix_arm forward "'my arm" : "my arm.yaml"
expect_all helix_arm forward 'my\ a' : "my arm.yaml"
expect_all helix_arm forward "\"arm'" : "arm's.yaml"
expect_all helix_arm forward "arm\\'" : "arm's.yaml"
expect helix_arm forward '"spat' : spatial_50 spatial_101
expect helix_arm forward "'spat" : spatial_50 spatial_101
expect_all helix_arm forward '"my arm.yaml"' --pre : --pressure-kpa
expect_all helix_arm "--format" '"c' : csv
expect_all helix_arm forward no :
expect helix_arm check --samples 5 dem : demo demo_serial
expect helix_arm tags --out x.pdf dem : demo
expect helix_arm follow demo --rig dem : demo
expect_all helix_arm forward demo --inputs no :  # left to readline, which completes files
# subcommands of subcommands
expect_all helix_arm camera "" : calibrate place
expect_all helix_arm camera cal : calibrate
expect helix_arm camera calibrate -- : --source --coefficients --format
expect helix_arm camera calibrate --source a.jpg b.jpg -- : --views
expect helix_arm camera place dem : demo
expect_all helix_arm regulator demo "" : probe set vent guard emulate
expect helix_arm regulator demo set -- : --pressure-kpa --yes
# values
expect_all helix_arm --format "" : text json csv
expect_all helix_arm --format csv fo : forward follow
expect helix_arm --format csv forward demo --pr : --pressure-kpa
expect_all helix_arm forward demo --format = c : csv  # as bash splits --format=c
expect_all helix_arm forward demo --format = : text json csv
expect helix_arm --set arm.tool.x_m = 1 forward dem : demo
expect helix_arm inverse demo --prefer m : min-pressure min-change
expect_all helix_arm tags demo --paper "" : a4 letter
expect_all helix_arm camera calibrate --coefficients "" : 0 2 4 5 8
expect helix_arm calibrate demo c.csv --fit st : stiffness
expect_all helix_arm calibrate demo c.csv --fit stiffness,pla : stiffness,placement
expect_all helix_arm path ci : circle
# --board is a flag that may have a value
expect_all helix_arm tags --board ch : charuco
expect_all helix_arm tags demo --board "" : tags charuco
expect_all helix_arm tags demo --board = ch : charuco
expect_all helix_arm tags --board = "" : tags charuco
expect helix_arm tags --board "" : tags charuco demo mine.yaml
expect helix_arm tags --board de : demo demo_modbus
expect helix_arm tags --board charuco de : demo demo_modbus
expect helix_arm tags --board = charuco de : demo demo_modbus
expect helix_arm tags --board charuco --sq : --squares --square-size-m
expect_all helix_arm tags --board --pap : --paper
expect_all helix_arm simulate demo --board ch : charuco
expect helix_arm simulate --board charuco de : demo
expect_all helix_arm camera calibrate --board "" : tags charuco
for subcommand in tags simulate "camera calibrate"; do
  # shellcheck disable=SC2086
  expect helix_arm $subcommand --dictionary DICT_APRIL : DICT_APRILTAG_16h5 DICT_APRILTAG_36h11
done
expect_all helix_arm new --regulator g : generic
# each option of the help of each subcommand, and of those below it
subcommands_of() { helix_arm "$@" --help | sed -n -E '/^Subcommands:/,$ s/^  ([a-z]+) .*/\1/p'; }
# expect_options WORD...: of this subcommand
expect_options() {
  local option
  local -i count=0
  while read -r option; do
    expect helix_arm "$@" "$option" : "$option"
    count+=1
  done < <(helix_arm "$@" --help | sed -n -E 's/^ +(-[a-z],)?(--[a-z-]+).*/\2/p')
  ((count > 0)) || fault "helix_arm $*: no options in the help"
}
mapfile -t subcommands < <(subcommands_of)
((${#subcommands[@]} >= 16)) || fault "subcommands: ${subcommands[*]}"
[[ ${HELIX_ARM_TEST_SIZE:-default} == all ]] || subcommands=(forward)
for subcommand in "${subcommands[@]}"; do
  expect_options "$subcommand"
  scene=()
  [[ $subcommand != regulator ]] || scene=(demo)
  while read -r nested; do
    expect_options "$subcommand" "${scene[@]}" "$nested"
  done < <(subcommands_of "$subcommand")
done
exit $faults
