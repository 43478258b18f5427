// Any bytes as the profile of a regulator: one that keeps its own rules, or faults that say why
// not; and what was read is read again from the document that is written of it.
#include <string>
#include <variant>

#include "helix_arm/io/fault_list.hpp"
#include "io/document/document.hpp"
#include "io/scene/scene_readers.hpp"
#include "memory_file.hpp"

namespace {

using namespace helix_arm;
using test::demand;

// Whether a document holds a good profile of any kind.
bool reads(const io::Value& document) {
  io::FaultList faults("profile.yaml");
  const auto profile = io::readProfile(document, nullptr, "profile", faults);
  demand(profile.has_value() || !faults.empty());
  if (profile) std::visit([](const auto& one) { one.validate(); }, *profile);
  return faults.empty();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  io::FaultList faults("profile.yaml");
  const auto document =
      io::parseDocument(std::string(reinterpret_cast<const char*>(bytes), size), {}, faults);
  demand(document.has_value() || !faults.empty());
  if (!document || !reads(*document) || !faults.empty()) return 0;
  const auto again = io::parseDocument(io::writeDocument(*document), {}, faults);
  demand(again.has_value() && faults.empty());
  demand(reads(*again));
  return 0;
}
