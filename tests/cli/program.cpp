#include "program.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <regex>
#include <sstream>
#include <stdexcept>

namespace servotwin {

std::vector<std::string> Answer::complaints() const {
  std::vector<std::string> lines;
  std::istringstream stream(err);
  const std::regex progress("[a-z]+ing .*, [0-9]+ s");
  for (std::string line; std::getline(stream, line);) {
    if (!std::regex_match(line, progress)) lines.push_back(line);
  }
  return lines;
}

std::ostream& operator<<(std::ostream& out, const Answer& answer) {
  return out << "exit status " << answer.status << "\nstandard output:\n"
             << answer.out << "standard error:\n"
             << answer.err;
}

std::string Folder::write(const std::string& name, const std::string& content) const {
  std::ofstream(path() / name, std::ios::binary) << content;
  return *this / name;
}

std::vector<std::string> Folder::list() const {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(path()))
    names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

std::string content_of(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

Program::Program(const std::vector<std::string>& arguments, const std::string& out)
    : out_(out.empty() ? folder_ / "out" : out), err_(folder_ / "err") {
  std::vector<std::string> words{SERVOTWIN_BINARY};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  argv.reserve(words.size() + 1);
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, out_.c_str(),
                                   O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, err_.c_str(),
                                   O_WRONLY | O_CREAT | O_TRUNC, 0600);
  const int failed = posix_spawn(&id_, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (failed != 0) throw std::runtime_error("cannot run " SERVOTWIN_BINARY);
}

Program::~Program() {
  if (id_ <= 0) return;
  ::kill(id_, SIGKILL);
  (void)answer();
}

std::string Program::so_far() const {
  // A device such as /dev/full has no end.
  return std::filesystem::is_regular_file(out_) ? content_of(out_) : std::string();
}

void Program::interrupt() const { ::kill(id_, SIGINT); }

Answer Program::answer() {
  int status = 0;
  ::waitpid(id_, &status, 0);
  id_ = -1;
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), so_far(),
          content_of(err_)};
}

Answer servotwin_says(const std::vector<std::string>& arguments, const std::string& out) {
  return Program(arguments, out).answer();
}

}  // namespace servotwin
