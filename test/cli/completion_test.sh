#!/bin/bash
# After the workspace is sourced, bash runs helix_arm and completes its subcommands, options and files.
# usage: completion_test.sh SETUP.BASH
set -eo pipefail
setup="$1"
# shellcheck disable=SC1090
source "$setup"

faults=0
# expect WORD... -- COMPLETION...: the last word completes to these, among others
expect() {
  local -a expected=()
  COMP_WORDS=()
  while [[ $1 != -- ]]; do COMP_WORDS+=("$1"); shift; done
  shift
  expected=("$@")
  COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
  _helix_arm
  local one
  for one in "${expected[@]}"; do
    if [[ " ${COMPREPLY[*]} " != *" $one "* ]]; then
      echo "${COMP_WORDS[*]}: $one is not among: ${COMPREPLY[*]}"
      faults=1
    fi
  done
}

helix_arm --help >/dev/null
complete -p helix_arm | grep -q _helix_arm
expect helix_arm "" -- forward inverse simulate calibrate
expect helix_arm fo -- forward follow
expect helix_arm forward --pre -- --pressure-kpa
expect helix_arm inverse scene.yaml --ti -- --tip
expect helix_arm --ver -- --version
expect helix_arm forward spat -- spatial_50 spatial_101
expect helix_arm check dem -- demo demo_serial
COMP_WORDS=(helix_arm forward con) COMP_CWORD=2
_helix_arm
[[ ${#COMPREPLY[@]} == 0 ]] || { echo "a scene is completed as ${COMPREPLY[*]}, not as a file"; faults=1; }
COMP_WORDS=(helix_arm xyz) COMP_CWORD=1
_helix_arm
[[ ${#COMPREPLY[@]} == 0 ]] || { echo "xyz completes to ${COMPREPLY[*]}"; faults=1; }
exit $faults
