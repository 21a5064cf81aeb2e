// Which columns of a foreign table are command, encoder and torque of which axis, by what programs
// and people call them: "Lagesollwert", "pos_cmd_m", "X1_CommandPosition". The command and the
// encoder of an axis have the same name but for the word that tells which of them it is.
// Any thread; errors: none.
#pragma once

#include <span>
#include <string>

namespace servotwin {

struct ColumnGuess {
  /// As ReadOptions::columns, "X.command=Sollwert[mm],X.actual=Istwert[mm]"; a unit that the file
  /// does not have is left as [unit]. Empty where no command is among the names.
  std::string columns;
  /// There is one command and one encoder for every axis, by their names, and each of these columns
  /// has a unit: nothing is left to ask.
  bool clear = false;
};

[[nodiscard]] ColumnGuess guess_columns(std::span<const std::string> names);

}  // namespace servotwin
