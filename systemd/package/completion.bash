# Completion of servotwin: its commands, the options of a command, and files.
_servotwin() {
  local word=${COMP_WORDS[COMP_CWORD]} help
  if ((COMP_CWORD == 1)); then
    help=$(servotwin --help 2>/dev/null | sed -n '/^Subcommands:/,$ s/^  \([a-z][a-z-]*\) .*/\1/p')
    mapfile -t COMPREPLY < <(compgen -W "$help" -- "$word")
  elif [[ $word == -* ]]; then
    help=$(servotwin "${COMP_WORDS[1]}" --help 2>/dev/null | grep -o -e '--[a-z][a-z-]*' | sort -u)
    mapfile -t COMPREPLY < <(compgen -W "$help" -- "$word")
  else
    mapfile -t COMPREPLY < <(compgen -f -- "$word")
    compopt -o filenames
  fi
}
complete -F _servotwin servotwin
