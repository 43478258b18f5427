// Any bytes as the profile of a regulator: one that keeps its own rules, or faults that say why
// not, never both; and what was read is read again from the document that is written of it.
#include <optional>
#include <string>

#include "helix_arm/io/fault_list.hpp"
#include "io/document/document.hpp"
#include "io/scene/profile_file.hpp"
#include "memory_file.hpp"

namespace {

using namespace helix_arm;
using test::demand;

// Whether a document holds a good profile of a kind.
template <class Profile>
bool reads(const io::Value& document, const char* kind,
           std::optional<Profile> (*reader)(const io::Value&, const std::string&,
                                            const std::string&, io::FaultList&)) {
  const io::Value* const value = document.find(kind);
  if (value == nullptr) return false;
  io::FaultList faults("profile.yaml");
  const std::optional<Profile> profile = reader(*value, kind, "profile", faults);
  demand(profile.has_value() == faults.empty());
  if (profile) profile->validate();
  return profile.has_value();
}

bool readsSerial(const io::Value& document) {
  return reads<regulator::SerialProfile>(document, "ascii_serial", io::readSerialProfile);
}

bool readsModbus(const io::Value& document) {
  return reads<regulator::ModbusProfile>(document, "modbus_tcp", io::readModbusProfile);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  io::FaultList faults("profile.yaml");
  const auto document =
      io::parseDocument(std::string(reinterpret_cast<const char*>(bytes), size), {}, faults);
  demand(document.has_value() || !faults.empty());
  if (!document) return 0;
  const bool serial = readsSerial(*document), modbus = readsModbus(*document);
  if (!faults.empty() || !(serial || modbus)) return 0;
  const auto again = io::parseDocument(io::writeDocument(*document), {}, faults);
  demand(again.has_value() && faults.empty());
  demand(readsSerial(*again) == serial && readsModbus(*again) == modbus);
  return 0;
}
