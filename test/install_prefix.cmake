# Installs a finished build to a folder of its own: run with -DBUILD=<build> -P. That folder is outside of the package, below which
# roslaunch would find its launch files too.
cmake_minimum_required(VERSION 3.16)
execute_process(COMMAND mktemp -d -t "helix_arm prefix.XXXXXX"
  RESULT_VARIABLE result OUTPUT_VARIABLE SCRATCH OUTPUT_STRIP_TRAILING_WHITESPACE)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "no temporary folder: ${result}")
endif()
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${SCRATCH}
  RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE message)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "cmake --install ended with ${result}: ${message}")
endif()
string(REGEX MATCHALL "-- (Installing|Up-to-date): [^\n]*" lines "${output}")
if(NOT lines)
  message(FATAL_ERROR "cmake --install says nothing of what it installs: ${output}")
endif()
foreach(line IN LISTS lines)
  string(REGEX REPLACE "^-- [^:]*: " "" path "${line}")
  string(FIND "${path}" "${SCRATCH}/" at)
  if(NOT at EQUAL 0)
    message(FATAL_ERROR "installed outside of ${SCRATCH}: ${path}")
  endif()
endforeach()
# The setup file names the new prefix and puts the command on PATH, for a shell that cannot know where a sourced file lies, too.
execute_process(
  COMMAND ${CMAKE_COMMAND} -E env --unset=CMAKE_PREFIX_PATH --unset=ROS_PACKAGE_PATH
    sh -c ". \"$0/setup.sh\"; printf '%s|' \"$CMAKE_PREFIX_PATH\" \"$ROS_PACKAGE_PATH\" \"$(command -v helix_arm)\"; helix_arm --version"
    ${SCRATCH}
  RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE message)
if(NOT result EQUAL 0 OR NOT output MATCHES "helix_arm [0-9]")
  message(FATAL_ERROR "the installed command ended with ${result}: ${output}${message}")
endif()
foreach(place "${SCRATCH}[:|]" "${SCRATCH}/share" "[|]${SCRATCH}/bin/helix_arm[|]")
  if(NOT output MATCHES "${place}")
    message(FATAL_ERROR "setup.sh does not lead to ${place}: ${output}")
  endif()
endforeach()

# The firmware of the board is there, without what was built of it, and builds from there.
set(firmware ${SCRATCH}/share/helix_arm/firmware)
if(NOT EXISTS ${firmware}/Makefile OR NOT EXISTS ${firmware}/main.c OR EXISTS ${firmware}/build)
  message(FATAL_ERROR "${firmware} lacks the sources of the firmware, or has what was built of them")
endif()
find_program(AVR_GCC avr-gcc)
find_program(MAKE_EXECUTABLE NAMES gmake make)
if(AVR_GCC AND MAKE_EXECUTABLE)
  execute_process(COMMAND ${MAKE_EXECUTABLE} -C ${firmware} RESULT_VARIABLE result OUTPUT_QUIET ERROR_VARIABLE message)
  if(NOT result EQUAL 0 OR NOT EXISTS ${firmware}/build/board_atmega328p_solenoid.hex)
    message(FATAL_ERROR "the installed firmware does not build: ${message}")
  endif()
endif()

# A package of somebody else finds it there, and links the library of the model with Eigen and yaml-cpp alone.
set(example ${SCRATCH}/share/helix_arm/examples)
execute_process(
  COMMAND ${CMAKE_COMMAND} -E env --unset=CMAKE_PREFIX_PATH
    sh -c ". \"$0/setup.sh\"; \"$1\" -S \"$2\" -B \"$0/example\" -DPYTHON_EXECUTABLE=\"$3\" -DCMAKE_BUILD_TYPE=Release"
    ${SCRATCH} ${CMAKE_COMMAND} ${example} ${PYTHON}
  RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE message)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "find_package(helix_arm) from ${SCRATCH} ended with ${result}: ${output}${message}")
endif()
execute_process(COMMAND ${CMAKE_COMMAND} --build ${SCRATCH}/example
  RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE message)
if(NOT result EQUAL 0)
  message(FATAL_ERROR "examples/forward.cpp does not build: ${output}${message}")
endif()
set(scene ${SCRATCH}/share/helix_arm/config/scenes/helical_50.yaml)
execute_process(COMMAND ${SCRATCH}/example/forward ${scene} 200 0 50
  RESULT_VARIABLE result OUTPUT_VARIABLE tip ERROR_VARIABLE message)
execute_process(COMMAND ${SCRATCH}/lib/helix_arm/helix_arm forward ${scene} --pressure-kpa 200,0,50 --format json
  OUTPUT_VARIABLE expected)
string(REGEX MATCHALL "-?[0-9.]+(e-?[0-9]+)?" tip "${tip}")
string(REGEX REPLACE ".*\"position_m\": *\\[([^]]*)\\].*" "\\1" expected "${expected}")
string(REGEX MATCHALL "-?[0-9.]+(e-?[0-9]+)?" expected "${expected}")
list(LENGTH tip numbers)
if(NOT result EQUAL 0 OR NOT numbers EQUAL 3)
  message(FATAL_ERROR "examples/forward ended with ${result}: ${tip} ${message}")
endif()
foreach(i RANGE 2)
  list(GET tip ${i} one)
  list(GET expected ${i} other)
  string(SUBSTRING "${one}" 0 11 one)  # about nine digits
  string(FIND "${other}" "${one}" at)
  if(NOT at EQUAL 0)
    message(FATAL_ERROR "examples/forward says ${tip}; the command says ${expected}")
  endif()
endforeach()
execute_process(COMMAND ldd ${SCRATCH}/example/forward OUTPUT_VARIABLE libraries)
string(FIND "${libraries}" "${SCRATCH}/lib/libhelix_arm_core" at)
if(at EQUAL -1 OR libraries MATCHES "not found|opencv|modbus|turbojpeg|ceres|roscpp|crypto")
  message(FATAL_ERROR "examples/forward needs more than helix_arm_core, Eigen and yaml-cpp: ${libraries}")
endif()

file(REMOVE_RECURSE ${SCRATCH})
