#pragma once

#include <functional>
#include <stdexcept>
#include <string>

namespace helix_arm::test {

/// What a call that must not be taken says; "accepted" where it is.
template <class Exception = std::invalid_argument>
std::string refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const Exception& error) {
    return error.what();
  }
  return "accepted";
}

}  // namespace helix_arm::test
