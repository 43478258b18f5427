#pragma once

#include <cstddef>
#include <string>
#include <string_view>

/// Text from outside (files, arguments, messages, devices, libraries) for messages, terminals and
/// logs, where it must neither act as a control sequence nor pass for a line of this program.
namespace helix_arm::basics {

/// An untrusted word for messages: characters other than printable ASCII become '?', and text
/// longer than `most` characters is truncated and ends in "...".
std::string quoted(const std::string& text, std::size_t most = 64);

/// A line for messages, whatever its language: control characters (newline and tab among them),
/// separators of lines, characters that change the direction of text, and bytes that are not UTF-8
/// become escapes such as \x1b and \u202e.
std::string printable(std::string_view line);

/// printable() of each line of a text, whose newlines stay.
std::string printableLines(std::string_view text);

}  // namespace helix_arm::basics
