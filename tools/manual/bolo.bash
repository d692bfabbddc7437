# Bash completion of bolo and bolod. The words come from the programs' own --help.

_bolo_words() { mapfile -t COMPREPLY < <(compgen -W "$1" -- "$cur"); }
_bolo_files() {
  compopt -o filenames 2>/dev/null
  mapfile -t COMPREPLY < <(compgen "$1" -- "$cur")
}

_bolo() {
  local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD - 1]} command=("${COMP_WORDS[0]}") help line
  # bash splits "--option=value" into three words.
  if [ "$cur" = = ]; then
    cur=
  elif [ "$prev" = = ]; then
    prev=${COMP_WORDS[COMP_CWORD - 2]}
  fi
  COMPREPLY=()
  if [ "${COMP_WORDS[0]##*/}" = bolo ]; then
    if [ "$COMP_CWORD" -eq 1 ]; then
      _bolo_words "$(bolo --help 2>/dev/null | sed -nE 's/^  ([a-z]+) +[^ ].*/\1/p') --help"
      return
    fi
    command+=("${COMP_WORDS[1]}")
  fi
  help=$("${command[@]}" --help 2>/dev/null) || return 0
  if [[ $prev == -?* ]]; then
    # Help line of the previous option: completes by its value's placeholder, or the list of words that its text begins with.
    line=$(grep -E -- "^ +(-[A-Za-z], )?$prev[, ]|^ +$prev, " <<<"$help" | head -1 | sed -E 's/^ +(-[A-Za-z], )?//')
    local value=${line#--* } # after the option's long name; begins with a blank if it takes no value
    case ${value%% *} in
      *DIR* | *FOLDER*) _bolo_files -d && return ;;
      *FILE* | *CAPTURE* | *IMAGE* | IN* | OUT* | *.*) _bolo_files -f && return ;;
      ?*)
        _bolo_words "$(sed -nE 's/^[^ ]+( \(=[^)]*\))? +([a-z0-9]+(, [a-z0-9]+)+( or [a-z0-9]+)?).*/\2/p' <<<"$value" |
          sed -E 's/, | or / /g')"
        return
        ;;
    esac
  fi
  case $cur in
    -*) _bolo_words "$(sed -nE 's/^ +(-[A-Za-z], )? *(--[a-z0-9-]+).*/\2/p' <<<"$help")" ;;
    *)
      case $(sed -nE '/^Usage:/{n;p}' <<<"$help") in
        *NAME*) _bolo_words "$(for f in /dev/shm/bolo.*; do [ -e "$f" ] && echo "${f#/dev/shm/bolo.}"; done)" ;;
        *\] | *"[OPTION...]") ;;
        *) _bolo_files -f ;;
      esac
      ;;
  esac
}

complete -F _bolo bolo bolod
