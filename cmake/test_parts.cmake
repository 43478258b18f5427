# What the tests of the core share, whether it is built alone or not.
# Expected values in 80 digits.
add_library(helix_arm_high_precision INTERFACE)
target_link_libraries(helix_arm_high_precision INTERFACE mpfr gmp)

add_library(helix_arm_allocation_counter STATIC EXCLUDE_FROM_ALL ${PROJECT_SOURCE_DIR}/test/support/allocation_counter.cpp)
target_include_directories(helix_arm_allocation_counter PRIVATE ${PROJECT_SOURCE_DIR}/test)

# Most of a test runs once, so that compiling it fast counts for more than running it fast. Those that repeat sums in loops
# of their own are built like the library.
function(helix_arm_optimise target)
  set(labels ${ARGN})
  if(NOT "property" IN_LIST labels AND NOT "extremes" IN_LIST labels AND NOT "accuracy" IN_LIST labels)
    target_compile_options(${target} PRIVATE -O1)
  endif()
endfunction()
