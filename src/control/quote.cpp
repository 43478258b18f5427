#include "helix_arm/control/quote.hpp"

namespace helix_arm::control {

std::string quoted(const std::string& text, std::size_t most) {
  std::string out = text.substr(0, most);
  for (char& c : out) {
    if (c < ' ' || c > '~') c = '?';
  }
  return text.size() > most ? out + "..." : out;
}

}  // namespace helix_arm::control
