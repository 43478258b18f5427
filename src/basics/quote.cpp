#include "helix_arm/basics/quote.hpp"

namespace helix_arm::basics {

std::string quoted(const std::string& text, std::size_t most) {
  std::string out = text.substr(0, most);
  for (char& c : out) {
    if (c < ' ' || c > '~') c = '?';
  }
  return text.size() > most ? out + "..." : out;
}

}  // namespace helix_arm::basics
