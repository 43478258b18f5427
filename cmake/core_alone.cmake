# The core library and its tests, for a computer that is not at hand: scripts/arm64.
enable_testing()
find_package(GTest REQUIRED)
include_directories(test)
include(cmake/test_parts.cmake)

# minutes each in qemu: scripts/arm64 --all
set(helix_arm_slow_tests lie_accuracy_test inverse_test exact_test jacobian_test loaded_error_test stiffness_table_test workspace_test
  tier_test)
function(helix_arm_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT" "LINK;LABELS" ${ARGN})
  add_executable(${name} ${ARG_UNPARSED_ARGUMENTS})
  target_link_libraries(${name} ${ARG_LINK} helix_arm_build GTest::gtest_main)
  target_compile_definitions(${name} PRIVATE HELIX_ARM_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  helix_arm_optimise(${name} ${ARG_LABELS})
  add_test(NAME ${name} COMMAND ${name})
  if(name IN_LIST helix_arm_slow_tests)
    set_tests_properties(${name} PROPERTIES LABELS slow TIMEOUT 7200)
  endif()
endfunction()

foreach(layer basics lie model statics dynamics control)
  add_subdirectory(test/${layer} test/${layer})
endforeach()
if(CMAKE_SYSTEM_PROCESSOR STREQUAL "aarch64")
  add_test(NAME vectors_test COMMAND ${Python3_EXECUTABLE} "${PROJECT_SOURCE_DIR}/test/model/vectors_test.py"
    ${CMAKE_OBJDUMP} $<TARGET_FILE:helix_arm_core>)
endif()
