// Lets a loop ask whether SIGINT (Ctrl-C) or SIGTERM was received since construction. One object at
// a time; main thread.
#pragma once

#include <csignal>

namespace servotwin::cli {

class Interrupt {
 public:
  Interrupt() {
    came_ = 0;
    struct sigaction action = {};
    action.sa_handler = [](int) { came_ = 1; };
    sigaction(SIGINT, &action, &before_int_);
    sigaction(SIGTERM, &action, &before_term_);
  }
  ~Interrupt() {
    sigaction(SIGINT, &before_int_, nullptr);
    sigaction(SIGTERM, &before_term_, nullptr);
  }
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  [[nodiscard]] bool came() const noexcept { return came_ != 0; }

 private:
  inline static volatile std::sig_atomic_t came_ = 0;
  struct sigaction before_int_ = {};
  struct sigaction before_term_ = {};
};

}  // namespace servotwin::cli
