# Sourced by setup.bash: completion of the command helix_arm, which knows by itself what may follow.

_helix_arm() {
  local word="${COMP_WORDS[COMP_CWORD]}"
  local -a lines
  mapfile -t lines < <("${COMP_WORDS[0]}" --complete "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
  COMPREPLY=("${lines[@]:1}")
  case ${lines[0]-} in
    "") compopt +o default 2>/dev/null ;;
    "*") ;;  # no words, so that readline completes files
    *) # files of a pattern besides the words, and folders
      mapfile -t -O "${#COMPREPLY[@]}" COMPREPLY < <(compgen -f -X "!${lines[0]}" -- "$word"; compgen -d -- "$word")
      compopt -o filenames 2>/dev/null
      ;;
  esac
}
complete -o default -F _helix_arm helix_arm
