#include "helix_arm/regulator/config.hpp"

#include "basics/text.hpp"

namespace helix_arm::regulator {

static_assert(std::size(kKinds) == std::variant_size_v<Config>, "each kind has its key");

DeviceFacts factsOf(const Config& config) {
  return std::visit([](const auto& kind) { return kind.facts(); }, config);
}

std::string describe(const Config& config) {
  const DeviceFacts facts = factsOf(config);
  return isHardware(config) ? facts.kind + " " + facts.profile + " at " + facts.address
                            : facts.kind;
}

std::string describeChannels(const Config& config) {
  const DeviceFacts facts = factsOf(config);
  return facts.channel_word + (facts.channels.empty() ? "" : " ") + basics::joined(facts.channels);
}

std::string addressOf(const Config& config, int channel) {
  const DeviceFacts facts = factsOf(config);
  const auto i = static_cast<std::size_t>(channel);
  return i < facts.channels.size() ? facts.channels[i] : std::to_string(channel);
}

bool isHardware(const Config& config) {
  return !std::holds_alternative<SimulatedRegulatorConfig>(config);
}

std::unique_ptr<Driver> makeDriver(const Config& config, int channels) {
  return std::visit([=](const auto& kind) { return kind.makeDriver(channels); }, config);
}

}  // namespace helix_arm::regulator
