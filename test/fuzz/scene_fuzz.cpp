// Any bytes as a scene file: a scene or a DocumentError, and what loads can be written and loaded.
#include "helix_arm/io/fault_list.hpp"
#include "helix_arm/io/scene.hpp"
#include "memory_file.hpp"

namespace {

using helix_arm::test::demand;
using helix_arm::test::MemoryFile;

bool loads(const MemoryFile& file) {
  try {
    helix_arm::io::loadScene(file.path());
    return true;
  } catch (const helix_arm::io::DocumentError& error) {
    demand(*error.what() != '\0');
    return false;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const MemoryFile file;
  file.write(data, size);
  if (!loads(file)) return 0;
  const std::string text = helix_arm::io::sceneText(file.path(), {{"name", "written"}});
  file.write(text.data(), text.size());
  demand(loads(file));
  return 0;
}
