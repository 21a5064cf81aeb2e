// Expectations on the text of an error: every part of it that a user needs has to be there, on one
// line.
#pragma once

#include <gtest/gtest.h>

#include <exception>
#include <initializer_list>
#include <string>

namespace servotwin::test {

/// Runs `action`, which must throw Error (not merely something derived from std::exception), and
/// expects each of `parts` in a message of one line.
template <class Error, class Action>
void expect_error(Action&& action, std::initializer_list<const char*> parts) {
  try {
    action();
  } catch (const Error& error) {
    const std::string message = error.what();
    for (const char* part : parts) {
      EXPECT_NE(message.find(part), std::string::npos) << "no \"" << part << "\" in: " << message;
    }
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    return;
  } catch (const std::exception& error) {
    ADD_FAILURE() << "another kind of error: " << error.what();
    return;
  }
  ADD_FAILURE() << "nothing was thrown";
}

}  // namespace servotwin::test
