// The commands of the tool. Each is one file: it declares its options on a subcommand of `app` and
// returns the function to run if that subcommand was called. Errors of a run: UsageError or
// std::invalid_argument for a wrong command line (exit status 2), any other exception for work that
// failed (exit status 1). The message is one line that says what failed and what to do.
#pragma once

#include <functional>
#include <stdexcept>

namespace CLI {  // NOLINT(readability-identifier-naming): the name of the library
class App;
}

namespace servotwin::cli {

class UsageError : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

struct Command {
  CLI::App* app = nullptr;
  std::function<void()> run;
};

[[nodiscard]] Command add_identify(CLI::App& app);
[[nodiscard]] Command add_predict(CLI::App& app);
[[nodiscard]] Command add_diagnose(CLI::App& app);
[[nodiscard]] Command add_simulate(CLI::App& app);
[[nodiscard]] Command add_learn(CLI::App& app);
[[nodiscard]] Command add_motion_law(CLI::App& app);
[[nodiscard]] Command add_characterize(CLI::App& app);
[[nodiscard]] Command add_frequency_response(CLI::App& app);
[[nodiscard]] Command add_multivariable(CLI::App& app);
[[nodiscard]] Command add_sequence(CLI::App& app);
[[nodiscard]] Command add_fit_axis(CLI::App& app);
[[nodiscard]] Command add_what_if(CLI::App& app);
[[nodiscard]] Command add_preview(CLI::App& app);
[[nodiscard]] Command add_put_in_force(CLI::App& app);
[[nodiscard]] Command add_replay(CLI::App& app);
[[nodiscard]] Command add_watch(CLI::App& app);
[[nodiscard]] Command add_mqtt(CLI::App& app);
[[nodiscard]] Command add_ros2(CLI::App& app);
[[nodiscard]] Command add_mtconnect(CLI::App& app);
[[nodiscard]] Command add_history(CLI::App& app);
[[nodiscard]] Command add_export(CLI::App& app);
[[nodiscard]] Command add_check_config(CLI::App& app);
[[nodiscard]] Command add_formats(CLI::App& app);
// These four read the option tables of all commands when they run: `app` must live until then.
[[nodiscard]] Command add_help(CLI::App& app);
[[nodiscard]] Command add_version(CLI::App& app);
[[nodiscard]] Command add_completion(CLI::App& app);
[[nodiscard]] Command add_manual(CLI::App& app);

}  // namespace servotwin::cli
