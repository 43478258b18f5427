# Sourced by setup.bash: completion of the command helix_arm, which knows by itself what may follow.

# A word of the command line as it will be read: without its quotes and backslashes, also while its quote is open. Into
# the variable `plain`.
_helix_arm_plain() {
  local rest="$1" quote="" char
  plain=""
  while [[ -n $rest ]]; do
    char="${rest:0:1}"
    rest="${rest:1}"
    if [[ -n $quote && $char == "$quote" ]]; then
      quote=""
    elif [[ -z $quote && ($char == \" || $char == \') ]]; then
      quote="$char"
    elif [[ $char == \\ && $quote != \' && (-z $quote || $rest == [\\\"\$\`]*) ]]; then
      plain+="${rest:0:1}"
      rest="${rest:1}"
    else
      plain+="$char"
    fi
  done
}

_helix_arm() {
  local plain word
  local -a lines words=()
  for word in "${COMP_WORDS[@]:1:COMP_CWORD}"; do
    _helix_arm_plain "$word"
    words+=("$plain")
  done
  mapfile -t lines < <("${COMP_WORDS[0]}" --complete "${words[@]}" 2>/dev/null)
  COMPREPLY=("${lines[@]:1}")
  case ${lines[0]-} in
    "") compopt +o default 2>/dev/null ;;
    "*") ;;  # no words, so that readline completes files
    *) # files of a pattern besides the words, and folders; readline quotes them as the word is quoted
      mapfile -t -O "${#COMPREPLY[@]}" COMPREPLY < <(compgen -f -X "!${lines[0]}" -- "$plain"; compgen -d -- "$plain")
      compopt -o filenames 2>/dev/null
      ;;
  esac
}
complete -o default -F _helix_arm helix_arm
