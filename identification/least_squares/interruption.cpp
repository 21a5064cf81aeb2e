#include "identification/least_squares/interruption.h"

#include <utility>

namespace servotwin {

namespace {

thread_local std::stop_token asked;

}  // namespace

Interruptible::Interruptible(std::stop_token stop)
    : before_(std::exchange(asked, std::move(stop))) {}

Interruptible::~Interruptible() { asked = std::move(before_); }

std::stop_token interruption() { return asked; }

void throw_if_interrupted() {
  if (asked.stop_requested()) throw Interrupted();
}

}  // namespace servotwin
