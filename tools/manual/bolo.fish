# Fish completion of bolo and bolod. The words come from the programs' own --help.
function __bolo_options
    $argv --help 2>/dev/null | string replace -rf '^ +(?:-\w, )? *(--[a-z0-9-]+)(?: [^ ]+)? *(.*)$' '$1\t$2'
end
complete -c bolo -n __fish_use_subcommand -f -a "(bolo --help | string replace -rf '^  ([a-z]+) +(\S.*)\$' '\$1\t\$2')"
complete -c bolo -n "not __fish_use_subcommand; and string match -q -- '-*' (commandline -ct)" -f \
    -a "(__bolo_options bolo (commandline -opc)[2])"
complete -c bolo -n "__fish_seen_subcommand_from stat view nuc record" -a "(string replace /dev/shm/bolo. '' /dev/shm/bolo.*)"
complete -c bolod -n "string match -q -- '-*' (commandline -ct)" -f -a "(__bolo_options bolod)"
