#include "actuator_entries.hpp"

#include "helix_arm/io/number.hpp"
#include "value_writer.hpp"

namespace helix_arm::io {

std::vector<Value::Entry>& sectionsOf(Value& document) {
  return findValue(*findValue(document, "arm"), "sections")->entries;
}

std::vector<ActuatorEntry> actuatorEntries(Value& document) {
  std::vector<ActuatorEntry> entries;
  int first = 0;
  std::vector<Value::Entry>& sections = sectionsOf(document);
  for (std::size_t k = 0; k < sections.size(); ++k) {
    const std::string path = indexPath("arm.sections", k);
    if (Value* ring = findValue(sections[k].value, "ring")) {
      const int count = static_cast<int>(*parseNumber(ring->find("count")->text));
      entries.push_back({ring, joinPath(path, "ring"), first, count});
      first += count;
      continue;
    }
    std::vector<Value::Entry>& actuators = findValue(sections[k].value, "actuators")->entries;
    for (std::size_t i = 0; i < actuators.size(); ++i) {
      const std::string item = indexPath(joinPath(path, "actuators"), i);
      entries.push_back({&actuators[i].value, item, first++, 1});
    }
  }
  return entries;
}

}  // namespace helix_arm::io
