#pragma once

#include "helix_arm/io/fault_list.hpp"
#include "support/temporary_file.hpp"

namespace helix_arm::test {

/// What loading a table by its path says, without that path; empty when it says nothing.
template <class Load>
std::string tableFaults(const std::string& text, Load load) {
  const TemporaryFile file(text);
  try {
    load(file.path());
  } catch (const io::DocumentError& error) {
    std::string message = error.what();
    for (std::size_t at; (at = message.find(file.path())) != std::string::npos;) {
      message.erase(at, file.path().size());
    }
    return message;
  }
  return {};
}

}  // namespace helix_arm::test
