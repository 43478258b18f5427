#pragma once

#include <string>

#include "helix_arm/model/response.hpp"
#include "map_reader.hpp"

namespace helix_arm::io {

/// Of a contraction.
inline constexpr char kResponseKey[] = "response";

/// Reads a `response`: how an actuator follows its pressure. An empty map is none. Values with
/// faults are reported and read as none.
model::Response readResponse(const Value& value, const std::string& path, FaultList& faults);

}  // namespace helix_arm::io
