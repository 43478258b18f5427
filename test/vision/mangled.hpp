#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "support/random.hpp"

namespace helix_arm::test {

using Bytes = std::vector<std::uint8_t>;

inline std::uint8_t randomByte(Random& random) {
  return static_cast<std::uint8_t>(random.integer(0, 255));
}

/// Nothing but chance; or chance after a sound beginning; or a sound picture with some bits turned
/// over, bytes cut out, or its end cut off.
inline Bytes mangled(const std::vector<Bytes>& sound, Random& random) {
  Bytes bytes;
  const int kind = random.integer(0, 4);
  if (kind > 0)
    bytes = sound[static_cast<std::size_t>(random.integer(0, static_cast<int>(sound.size()) - 1))];
  const auto place = [&] { return random.integer(0, static_cast<int>(bytes.size()) - 1); };
  switch (kind) {
    case 0:
      bytes.resize(static_cast<std::size_t>(random.integer(0, 600)));
      std::generate(bytes.begin(), bytes.end(), [&] { return randomByte(random); });
      break;
    case 1:
      std::generate(bytes.begin() + place(), bytes.end(), [&] { return randomByte(random); });
      break;
    case 2:
      for (int i = random.integer(1, 12); i > 0; --i) {
        bytes[static_cast<std::size_t>(place())] ^=
            static_cast<std::uint8_t>(1 << random.integer(0, 7));
      }
      break;
    case 3: {
      const int from = place();
      bytes.erase(bytes.begin() + from,
                  bytes.begin() +
                      std::min<int>(from + random.integer(1, 40), static_cast<int>(bytes.size())));
      break;
    }
    default:
      bytes.resize(static_cast<std::size_t>(place()));
  }
  return bytes;
}

}  // namespace helix_arm::test
