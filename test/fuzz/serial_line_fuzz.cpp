// Any bytes as a device's line: a reading of the right number of finite pressures or a BadReply,
// for the reply templates of the shipped profiles.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "helix_arm/regulator/driver.hpp"
#include "regulator/line_format.hpp"
#include "support/serial_profiles.hpp"

namespace {

using namespace helix_arm::regulator;

void demand(bool law) {
  if (!law) std::abort();
}

// A refusal says why, and only what is refused throws.
void checkRefusal(const LineFormat& format, std::string_view line, const std::string& address,
                  std::size_t pressures) {
  const bool fits = format.match(line, address, pressures).has_value();
  try {
    format.parse(line, address, pressures);
    demand(fits);
  } catch (const BadReply& error) {
    demand(!fits);
    for (const char* c = error.what(); *c != '\0'; ++c) demand(*c >= ' ' && *c <= '~');
  }
}

void check(const LineFormat& format, std::string_view line, const std::string& address,
           std::size_t pressures) {
  const std::optional<LineFields> fields = format.match(line, address, pressures);
  if (!fields) return;
  const std::size_t expected = format.has("{pressures}")  ? pressures
                               : format.has("{pressure}") ? 1
                                                          : 0;
  demand(fields->pressures.size() == expected);
  for (const double pressure : fields->pressures) demand(std::isfinite(pressure));
  demand(fields->set_point.has_value() == format.has("{set_point}"));
  demand(!fields->set_point || std::isfinite(*fields->set_point));
  demand(fields->supply.has_value() == format.has("{supply}"));
  demand(!fields->supply || std::isfinite(*fields->supply));
}

void checkAll(const SerialProfile& profile, const SerialLines& lines, std::string_view line) {
  for (const auto* format : {&lines.reply, &lines.write_reply, &lines.vent_reply, &lines.write,
                             &lines.read, &lines.supply_line}) {
    for (std::size_t pressures = 0; *format && pressures <= 4; ++pressures) {
      check(**format, line, profile.one_by_one ? "A" : "", pressures);
    }
  }
  checkRefusal(*lines.reply, line, profile.one_by_one ? "A" : "", 3);
  for (const LineFormat& format : lines.skip) check(format, line, "", 0);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  static const SerialProfile profiles[] = {helix_arm::test::alicatProfile(),
                                           helix_arm::test::ctrlPProfile(),
                                           helix_arm::test::genericProfile()};
  static const SerialLines lines[] = {SerialLines(profiles[0]), SerialLines(profiles[1]),
                                      SerialLines(profiles[2])};
  const std::string_view line(reinterpret_cast<const char*>(bytes), size);
  for (std::size_t i = 0; i < 3; ++i) checkAll(profiles[i], lines[i], line);
  return 0;
}
