#include "cli/program/manual.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <cstdint>
#include <cstdio>
#include <map>
#include <tuple>
#include <utility>

#include "cli/program/examples.h"

namespace servotwin::cli {
namespace {

/// An option of so many commands is described once for all of them.
constexpr std::ptrdiff_t kCommandsThatShare = 3;

/// The length of a line of the source.
constexpr std::size_t kLineLength = 78;

/// The code point that begins at `at` of UTF-8, and moves `at` behind it.
std::uint32_t next_code_point(const std::string& text, std::size_t& at) {
  const auto first = static_cast<unsigned char>(text[at++]);
  if (first < 0x80) return first;
  const int more = first >= 0xF0 ? 3 : first >= 0xE0 ? 2 : 1;
  std::uint32_t point = first & (0x3FU >> more);
  for (int k = 0; k < more && at < text.size(); ++k) {
    point = (point << 6U) | (static_cast<unsigned char>(text[at++]) & 0x3FU);
  }
  return point;
}

/// Text for troff, where some characters would become typographic ones. `hyphens`: a - may be
/// printed as a hyphen, as it is right within a word.
std::string roff_escaped(const std::string& text, bool hyphens) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::uint32_t point = next_code_point(text, at);
    switch (point) {
      case '\\':
        out += "\\(rs";
        break;
      case '-':
        out += hyphens ? "-" : "\\-";
        break;
      case '\'':
        out += "\\(aq";
        break;
      case '"':
        out += "\\(dq";
        break;
      case '`':
        out += "\\(ga";
        break;
      case '^':
        out += "\\(ha";
        break;
      case '~':
        out += "\\(ti";
        break;
      default:
        if (point < 0x80) {
          out += static_cast<char>(point);
        } else {
          char name[16];
          std::snprintf(name, sizeof name, "\\[u%04X]", static_cast<unsigned>(point));
          out += name;
        }
    }
  }
  return out;
}

std::string literal(const std::string& text) { return roff_escaped(text, false); }
std::string bold(const std::string& text) { return "\\fB" + literal(text) + "\\fR"; }
std::string italic(const std::string& text) { return "\\fI" + literal(text) + "\\fR"; }

/// A word of a sentence. Names of options and of files keep their -.
std::string prose_word(const std::string& word) {
  const bool plain = std::all_of(word.begin(), word.end(), [](unsigned char c) {
    return std::isalpha(c) != 0 ||
           std::string("-,.;:()").find(static_cast<char>(c)) != std::string::npos;
  });
  return roff_escaped(word, plain && word.front() != '-' && word.find("(-") == word.npos);
}

/// A line that troff does not take for a request.
std::string guarded(const std::string& line) {
  return (line.starts_with('.') || line.starts_with('\'') ? "\\&" : "") + line + "\n";
}

/// Sentences, in lines of the source.
std::string prose(const std::string& text) {
  std::string out, line;
  for (const std::string& word : CLI::detail::split(text, ' ')) {
    if (word.empty()) continue;
    const std::string shown = prose_word(word);
    if (!line.empty() && line.size() + 1 + shown.size() > kLineLength) {
      out += guarded(line);
      line.clear();
    }
    line += (line.empty() ? "" : " ") + shown;
  }
  return line.empty() ? out : out + guarded(line);
}

std::string heading(const char* macro, std::string title) {
  if (std::string(macro) == ".SH") {
    std::transform(title.begin(), title.end(), title.begin(),
                   [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  }
  return std::string(macro) + " " + (title.find(' ') == title.npos ? "" : "\"") + literal(title) +
         (title.find(' ') == title.npos ? "" : "\"") + "\n";
}

/// "servotwind(8)" with a bold name.
std::string page_name(const std::string& page) {
  const std::size_t open = page.find('(');
  return bold(page.substr(0, open)) + page.substr(open);
}

std::string example_line(const std::string& line) {
  return ".PP\n.RS 4\n.EX\n" + guarded(literal(line)) + ".EE\n.RE\n";
}

std::string section(const ManualSection& section) {
  std::string out = heading(".SH", section.title);
  bool first = true;
  for (const std::string& paragraph : section.paragraphs) {
    out += (first ? "" : ".PP\n") + prose(paragraph);
    first = false;
  }
  for (const ManualEntry& entry : section.entries) {
    out += ".TP\n" + guarded(bold(entry.term)) + prose(entry.meaning);
  }
  for (const ManualExample& example : section.examples) {
    out += (first ? "" : ".PP\n") + prose(example.purpose) + example_line(example.line);
    first = false;
  }
  return out;
}

/// "X", "[OUT]", "M.json ..."
std::string value_of(const Argument& argument) {
  if (argument.kind == ValueKind::kNone) return "";
  std::string value = italic(argument.value);
  if (argument.value_optional) value = "[" + value + "]";
  return " " + value + (argument.many_values ? " ..." : "");
}

/// "REC", "[PATH]"
std::string positional(const Argument& argument) {
  const std::string name = italic(argument.names.front()) + (argument.many_values ? "..." : "");
  return argument.required ? name : "[" + name + "]";
}

/// An option or a positional argument as an entry of a list.
std::string entry(const Argument& argument, bool is_positional) {
  std::string out = ".TP\n";
  if (is_positional) {
    out += guarded(italic(argument.names.front()));
  } else {
    std::vector<std::string> names;
    for (const std::string& name : argument.names) names.push_back(bold(name));
    out += guarded(joined(names, ", ") + value_of(argument));
  }
  std::string notes;
  const auto note = [&](const std::string& text) { notes += (notes.empty() ? "" : "; ") + text; };
  if (argument.required && !is_positional) note("required");
  if (!argument.range.empty()) note(argument.range);
  if (!argument.needs.empty()) note("only with " + joined(argument.needs, ", "));
  out += prose(argument.description + (notes.empty() ? "" : " (" + notes + ")"));
  // The names of commands are in the page already.
  if (argument.kind == ValueKind::kChoice && argument.value != "COMMAND") {
    std::vector<std::string> choices;
    for (const std::string& choice : argument.choices) choices.push_back(bold(choice));
    out += std::string(".br\n") +
           (argument.comma_separated ? "One or more of, separated by commas:\n" : "One of:\n") +
           joined(choices, ",\n") + "\n";
  }
  return out;
}

bool is_help(const Argument& option) { return option.names.back() == "--help"; }

/// The options that several commands have alike, by name. A required one is described where it is
/// required, and so is one that commands have in a second form.
std::vector<Argument> shared_options(const Usage& program) {
  std::map<std::string, std::pair<std::ptrdiff_t, Argument>> most;  // by name: how many have it
  for (const Usage& command : program.commands) {
    for (const Argument& option : command.options) {
      if (is_help(option) || option.required) continue;
      const auto has_it = [&](const Usage& other) {
        return std::find(other.options.begin(), other.options.end(), option) != other.options.end();
      };
      const std::ptrdiff_t sharing =
          std::count_if(program.commands.begin(), program.commands.end(), has_it);
      auto& [count, form] = most[option.names.back()];
      if (sharing > count) std::tie(count, form) = std::pair(sharing, option);
    }
  }
  std::vector<Argument> shared;
  for (const auto& [name, form] : most) {
    if (form.first >= kCommandsThatShare) shared.push_back(form.second);
  }
  return shared;
}

/// A command line with what has to be given.
std::string synopsis(const std::string& name, const Usage& command) {
  std::string out = bold(name);
  bool optional = false;
  for (const Argument& option : command.options) {
    if (option.required) {
      out += " " + bold(option.names.back()) + value_of(option);
    } else if (!is_help(option)) {
      optional = true;
    }
  }
  if (optional) out += " [" + italic("OPTION") + "...]";
  for (const Argument& argument : command.positionals) out += " " + positional(argument);
  return guarded(out);
}

std::string command_section(const std::string& program, const Usage& command,
                            const std::vector<Argument>& shared) {
  std::string out = heading(".SS", program + " " + command.name) +
                    synopsis(program + " " + command.name, command) + ".PP\n" +
                    prose(command.summary);
  for (const Argument& argument : command.positionals) out += entry(argument, true);
  std::vector<std::string> elsewhere;
  for (const Argument& option : command.options) {
    if (is_help(option)) continue;
    if (std::find(shared.begin(), shared.end(), option) != shared.end()) {
      elsewhere.push_back(bold(option.names.back()));
    } else {
      out += entry(option, false);
    }
  }
  if (!elsewhere.empty()) {
    out += ".PP\nAlso, as described under COMMON OPTIONS:\n" + joined(elsewhere, ",\n") + ".\n";
  }
  for (const std::string& line : examples_of(command.name)) out += example_line(line);
  return out;
}

std::string commands_sections(const Usage& program) {
  const std::vector<std::string> groups = groups_of(program);
  std::string out = heading(".SH", "Commands");
  for (const std::string& group : groups) {
    std::vector<std::string> names;
    for (const Usage& command : program.commands) {
      if (command.group == group) names.push_back(bold(command.name));
    }
    out += ".TP\n" + guarded(literal(group)) + joined(names, ",\n") + "\n";
  }
  const std::vector<Argument> shared = shared_options(program);
  for (const std::string& group : groups) {
    out += heading(".SH", group);
    for (const Usage& command : program.commands) {
      if (command.group == group) out += command_section(program.name, command, shared);
    }
  }
  if (!shared.empty()) out += heading(".SH", "Common options");
  for (const Argument& option : shared) out += entry(option, false);
  return out;
}

}  // namespace

std::string manual_page(const Usage& program, const ManualText& text, const std::string& version,
                        const std::string& date) {
  std::string name = program.name;
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  std::string out = ".\\\" Written by: servotwin manual --program " + program.name + "\n.TH " +
                    name + " " + std::to_string(text.section) + " \"" + date + "\" \"servotwin " +
                    literal(version) + "\" \"" + text.book + "\"\n";
  out +=
      ".nh\n.ad l\n";  // names and options are not to be hyphenated, nor lines filled with blanks
  out += heading(".SH", "Name") + literal(program.name) + " \\- " + prose(text.title);
  out += heading(".SH", "Synopsis");
  if (program.commands.empty()) {
    out += synopsis(program.name, program);
  } else {
    out += bold(program.name) + " " + italic("COMMAND") + " [" + italic("ARGUMENT") +
           "...]\n.br\n" + bold(program.name + " help") + " [" + italic("COMMAND") + "]\n";
  }
  for (const ManualSection& one : text.before) out += section(one);
  if (!program.commands.empty()) out += commands_sections(program);
  out += heading(".SH", "Options");
  if (!program.commands.empty()) out += prose("Every command takes --help as well.");
  for (const Argument& option : program.options) out += entry(option, false);
  for (const ManualSection& one : text.after) out += section(one);
  out += heading(".SH", "See also");
  std::vector<std::string> pages;
  for (const std::string& page : text.see_also) pages.push_back(page_name(page));
  return out + joined(pages, ",\n") + "\n";
}

}  // namespace servotwin::cli
