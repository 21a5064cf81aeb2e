#include "cli/program/completion.h"

#include <map>

namespace servotwin::cli {
namespace {

/// `text` with a backslash before each of `special`.
std::string backslashed(const std::string& text, const std::string& special) {
  std::string out;
  for (const char c : text) {
    if (special.find(c) != special.npos) out += '\\';
    out += c;
  }
  return out;
}

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  for (std::size_t at = 0; (at = text.find(what, at)) != text.npos; at += with.size()) {
    text.replace(at, what.size(), with);
  }
  return text;
}

std::string heading(const Usage& program, const std::string& shell) {
  return "# Completion of " + program.name + " for " + shell +
         ", written by: servotwin completion " + shell +
         (program.name == "servotwin" ? "" : " --program " + program.name) + "\n";
}

std::vector<std::string> names_of_all(const std::vector<Argument>& options) {
  std::vector<std::string> names;
  for (const Argument& option : options) {
    names.insert(names.end(), option.names.begin(), option.names.end());
  }
  return names;
}

// bash ----------------------------------------------------------------------

/// What `kind` is set to in the script, with the values that belong to it.
std::string bash_kind(const Argument& argument) {
  switch (argument.kind) {
    case ValueKind::kChoice:
      return std::string("kind=") + (argument.comma_separated ? "list" : "words") + " words='" +
             joined(argument.choices, " ") + "'";
    case ValueKind::kFile:
      return "kind=files";
    case ValueKind::kDirectory:
      return "kind=directories";
    case ValueKind::kNone:
    case ValueKind::kOther:
      break;
  }
  return "kind=nothing";
}

/// Sets the words and the kind of what is typed after a command.
std::string bash_branch(const Usage& command, const std::string& indent) {
  std::string out = indent + "options='" + joined(names_of_all(command.options), " ") + "'\n";
  if (!command.commands.empty()) {
    std::vector<std::string> names;
    for (const Usage& one : command.commands) names.push_back(one.name);
    out += indent + "kind=words words='" + joined(names, " ") + "'\n";
  } else {
    out += indent +
           (command.positionals.empty() ? "kind=nothing" : bash_kind(command.positionals.front())) +
           "\n";
  }
  std::map<std::string, std::vector<std::string>> cases;  // kind, and the options of that kind
  for (const Argument& option : command.options) {
    if (option.kind == ValueKind::kNone) continue;
    std::vector<std::string>& names = cases[bash_kind(option)];
    names.insert(names.end(), option.names.begin(), option.names.end());
  }
  if (cases.empty()) return out;
  out += indent + "case $before in\n";
  for (const auto& [kind, names] : cases) {
    out += indent + joined(names, " | ") + ") is_value=1 " + kind + " ;;\n";
  }
  return out + indent + "esac\n";
}

// zsh -----------------------------------------------------------------------

/// In single quotes.
std::string zsh_quoted(const std::string& text) {
  return "'" + replaced(text, "'", R"('\'')") + "'";
}

std::string zsh_message(const std::string& text) { return backslashed(text, "\\:"); }

/// ":REC:_files", the part of a specification that is about the value.
std::string zsh_value(const Argument& argument, bool optional, const std::string& name) {
  std::string action = " ";
  switch (argument.kind) {
    case ValueKind::kChoice:
      action = argument.comma_separated
                   ? " _values -s , " + backslashed(name, " ") + " " + joined(argument.choices, " ")
                   : "(" + joined(argument.choices, " ") + ")";
      break;
    case ValueKind::kFile:
      action = "_files";
      break;
    case ValueKind::kDirectory:
      action = "_files -/";
      break;
    case ValueKind::kNone:
    case ValueKind::kOther:
      break;
  }
  return std::string(optional ? "::" : ":") + zsh_message(name) + ":" + action;
}

std::string zsh_option(const Argument& option) {
  const std::string description = "[" + backslashed(option.description, "\\[]:") + "]";
  const bool ends_all = option.names.back() == "--help" || option.names.back() == "--version";
  std::string out;
  for (const std::string& name : option.names) {
    std::string spec = name;
    if (option.kind != ValueKind::kNone) {
      spec += (name.starts_with("--") ? "=" : "+") + description +
              zsh_value(option, option.value_optional, option.value);
    } else {
      spec += description;
    }
    if (ends_all) {
      spec = "(- *)" + spec;
    } else if (option.repeats) {
      spec = "*" + spec;
    } else if (option.names.size() > 1) {
      spec = "(" + joined(option.names, " ") + ")" + spec;
    }
    out += (out.empty() ? "" : " ") + zsh_quoted(spec);
  }
  return out;
}

/// The call of _arguments for a command.
std::string zsh_arguments(const Usage& command, const std::string& indent) {
  std::string out = indent + "_arguments -s";
  const std::string next = " \\\n" + indent + "  ";
  for (const Argument& option : command.options) out += next + zsh_option(option);
  for (const Argument& argument : command.positionals) {
    out += next + zsh_quoted((argument.many_values ? "*" : "") +
                             zsh_value(argument, !argument.required && !argument.many_values,
                                       argument.names.front()));
  }
  return out + "\n";
}

// fish ----------------------------------------------------------------------

std::string fish_quoted(const std::string& text) { return "'" + backslashed(text, "\\'") + "'"; }

std::string fish_choices(const Argument& argument, const std::string& prefix) {
  return argument.comma_separated
             ? fish_quoted("(" + prefix + "_list " + joined(argument.choices, " ") + ")")
             : fish_quoted(joined(argument.choices, " "));
}

/// "-x -a 'a b'", the part of `complete` that is about the value.
std::string fish_value(const Argument& option, const std::string& prefix) {
  if (option.value_optional) return "";  // fish knows none that may be left out
  switch (option.kind) {
    case ValueKind::kNone:
      return "";
    case ValueKind::kChoice:
      return " -x -a " + fish_choices(option, prefix);
    case ValueKind::kFile:
      return " -r -F";
    case ValueKind::kDirectory:
      return " -x -a '(__fish_complete_directories)'";
    case ValueKind::kOther:
      break;
  }
  return " -x";
}

std::string fish_options(const Usage& command, const std::string& start,
                         const std::string& prefix) {
  std::string out;
  for (const Argument& option : command.options) {
    out += start;
    for (const std::string& name : option.names) {
      out += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
    }
    out += fish_value(option, prefix) + " -d " + fish_quoted(option.description) + "\n";
  }
  for (const Argument& argument : command.positionals) {
    if (argument.kind == ValueKind::kFile) out += start + " -F\n";
    if (argument.kind == ValueKind::kChoice) {
      out += start + " -a " + fish_choices(argument, prefix) + "\n";
    }
  }
  return out;
}

}  // namespace

std::string bash_completion(const Usage& program) {
  const std::string function = "_" + program.name;
  std::string out = heading(program, "bash") + function + R"(() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]}
  local options='' kind='' words='' is_value='' given=''
  # Bash makes a word of its own of the = in --option=value.
  if [[ $word == = ]]; then
    word=''
  elif [[ $before == = ]]; then
    before=${COMP_WORDS[COMP_CWORD - 2]}
  fi
)";
  if (program.commands.empty()) {
    out += bash_branch(program, "  ");
  } else {
    out += R"(  local command='' index
  for ((index = 1; index < COMP_CWORD; index++)); do
    if [[ ${COMP_WORDS[index]} != -* ]]; then
      command=${COMP_WORDS[index]}
      break
    fi
  done
  case $command in
  '')
)" + bash_branch(program, "    ") +
           "    ;;\n";
    for (const Usage& command : program.commands) {
      out += "  " + command.name + ")\n" + bash_branch(command, "    ") + "    ;;\n";
    }
    out += "  esac\n";
  }
  out += R"(  if [[ $word == --* || (-z $is_value && $word == -*) ]]; then
    kind=words words=$options
  fi
  COMPREPLY=()
  # Readline completes files by itself where nothing is found here and it is not told not to.
  case $kind in
  words) mapfile -t COMPREPLY < <(compgen -W "$words" -- "$word") ;;
  list)
    if [[ $word == *,* ]]; then given=${word%,*},; fi
    mapfile -t COMPREPLY < <(compgen -P "$given" -W "$words" -- "${word##*,}")
    ;;
  directories) compopt -o dirnames 2>/dev/null ;;
  esac
  if [[ $kind != files ]]; then compopt +o default 2>/dev/null; fi
  return 0
}
complete -o default -F )" +
         function + " " + program.name + "\n";
  return out;
}

std::string zsh_completion(const Usage& program) {
  const std::string function = "_" + program.name;
  std::string out =
      "#compdef " + program.name + "\n" + heading(program, "zsh") + function + "() {\n";
  if (program.commands.empty()) {
    out += zsh_arguments(program, "  ");
  } else {
    out += R"(  local curcontext=$curcontext context state state_descr line
  local -a commands
  typeset -A opt_args
  _arguments -C -s)";
    for (const Argument& option : program.options) out += " \\\n    " + zsh_option(option);
    out += R"( \
    ': :->command' '*:: :->arguments' && return 0
  case $state in
  command)
    commands=(
)";
    for (const Usage& command : program.commands) {
      out += "      " + zsh_quoted(command.name + ":" + zsh_message(command.summary)) + "\n";
    }
    out += R"(    )
    _describe -t commands command commands
    ;;
  arguments)
    curcontext=${curcontext%:*:*}:)" +
           program.name + R"(-$line[1]:
    case $line[1] in
)";
    for (const Usage& command : program.commands) {
      out += "    " + command.name + ")\n" + zsh_arguments(command, "      ") + "      ;;\n";
    }
    out += "    esac\n    ;;\n  esac\n";
  }
  return out + "}\nif [[ $funcstack[1] == " + function + " ]]; then\n  " + function +
         " \"$@\"\nelse\n  compdef " + function + " " + program.name + "\nfi\n";
}

std::string fish_completion(const Usage& program) {
  const std::string prefix = "__" + program.name;
  const std::string complete = "complete -c " + program.name;
  std::string out = heading(program, "fish");
  out += "function " + prefix + R"(_list -d 'Names that are joined by commas'
  __fish_complete_list , "string split ' ' '$argv'"
end
)";
  if (program.commands.empty()) {
    return out + complete + " -f\n" + fish_options(program, complete, prefix);
  }
  out += "function " + prefix + R"(_command -d 'Is this the command that was typed?'
  set -l typed (string match -v -- '-*' (commandline -opc)[2..])
  test "$typed[1]" = "$argv[1]"
end
)" + complete +
         " -f\n";
  const auto start = [&](const std::string& command) {
    return complete + " -n '" + prefix + "_command " + command + "'";
  };
  const std::string none = start(R"("")");
  for (const Usage& command : program.commands) {
    out += none + " -a " + command.name + " -d " + fish_quoted(command.summary) + "\n";
  }
  out += fish_options(program, none, prefix);
  for (const Usage& command : program.commands) {
    out += fish_options(command, start(command.name), prefix);
  }
  return out;
}

}  // namespace servotwin::cli
