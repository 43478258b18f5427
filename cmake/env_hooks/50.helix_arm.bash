# Sourced by setup.bash: the command helix_arm of this workspace, and its completion.

if ! type -P helix_arm >/dev/null; then
  _helix_arm_program="${CATKIN_ENV_HOOK_WORKSPACE:-}/lib/helix_arm/helix_arm"
  helix_arm() { "$_helix_arm_program" "$@"; }
fi

# Subcommands and options are what --help of the program lists. The first word of a subcommand is a shipped scene or a file;
# other words are files.
_helix_arm() {
  local program="${COMP_WORDS[0]}" word="${COMP_WORDS[COMP_CWORD]}" subcommand="" i
  for ((i = 1; i < COMP_CWORD; ++i)); do
    if [[ ${COMP_WORDS[i]} != -* ]]; then
      subcommand="${COMP_WORDS[i]}"
      break
    fi
  done
  COMPREPLY=()
  if [[ $word == -* ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$("$program" ${subcommand:+"$subcommand"} --help 2>/dev/null |
      sed -n -E 's/^ +(-[a-z],)?(--[a-z-]+).*/\2/p')" -- "$word")
  elif [[ -z $subcommand ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$("$program" --help 2>/dev/null |
      sed -n -E '/^Subcommands:/,$s/^  ([a-z]+) .*/\1/p')" -- "$word")
  elif ((i + 1 == COMP_CWORD)) && [[ $subcommand != @(path|new) ]]; then
    local scenes
    scenes="$(rospack find helix_arm 2>/dev/null)/config/scenes"
    mapfile -t COMPREPLY < <(compgen -W "$(cd "$scenes" 2>/dev/null && printf '%s ' *.yaml | sed 's/\.yaml//g')" -- "$word")
    if ((${#COMPREPLY[@]})); then mapfile -t -O "${#COMPREPLY[@]}" COMPREPLY < <(compgen -f -- "$word"); fi
  fi
}
complete -o default -F _helix_arm helix_arm
