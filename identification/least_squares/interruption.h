// A long computation that is asked to end.
//
//   const Interruptible until(stop);   in the thread that begins it
//   throw_if_interrupted();            in the solvers, before every round
//
// The request holds for the thread and for those that in_parallel() starts for it. It is no
// argument of every function between the caller and the solvers, because none of them does anything
// with it.
#pragma once

#include <exception>
#include <stop_token>

namespace servotwin {

/// Thrown by a computation that was asked to end. No std::runtime_error: what goes on where a fit
/// fails does not go on after this.
class Interrupted : public std::exception {
 public:
  [[nodiscard]] const char* what() const noexcept override {
    return "stopped before it was finished";
  }
};

/// While it lives, computations of this thread end when `stop` is requested. One within the life of
/// another holds instead of it.
class Interruptible {
 public:
  explicit Interruptible(std::stop_token stop);
  Interruptible(const Interruptible&) = delete;
  Interruptible& operator=(const Interruptible&) = delete;
  ~Interruptible();

 private:
  std::stop_token before_;
};

/// What interrupts this thread, for another one that computes for it; none where nothing does.
[[nodiscard]] std::stop_token interruption();

/// Throws Interrupted where this thread was asked to end.
void throw_if_interrupted();

}  // namespace servotwin
