#pragma once

#include <string>
#include <variant>

/// Results of checks of what data can cause, such as a message of another node.
namespace helix_arm::basics {

/// Why something was refused, and the message for its sender.
///
/// @tparam Fault  enumeration of the reasons.
template <class Fault>
struct Refusal {
  Fault fault;
  std::string message;  ///< names the culprit and the remedy
};

/// The checked value, or why it was refused.
template <class T, class Fault>
using Checked = std::variant<T, Refusal<Fault>>;

}  // namespace helix_arm::basics
