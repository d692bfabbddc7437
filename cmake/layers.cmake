# One library for each layer or driver. The DEPENDS lists here and in the folders are the only allowed directions of
# #include; tests/architecture/layers_test.py enforces them.

# Warnings, sanitizers and include root for all of our targets.
add_library(bolo_options INTERFACE)
set(BOLO_WARNINGS -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Werror)
target_compile_options(bolo_options INTERFACE ${BOLO_WARNINGS})
# GCC 12 warns about overlaps inside std::string's own operator+ (GCC bug 105651).
target_compile_options(bolo_options INTERFACE $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>)
# GCC's garbage collection starts at a heap of 128 MB by default; starting at 1 GB saves an eighth of the compile time.
target_compile_options(bolo_options INTERFACE $<$<CXX_COMPILER_ID:GNU>:--param=ggc-min-heapsize=1000000>)
# std::regex, which cxxopts uses for parsing by default, takes a third of a verb's compile time.
target_compile_definitions(bolo_options INTERFACE CXXOPTS_NO_REGEX)
target_include_directories(bolo_options INTERFACE ${PROJECT_SOURCE_DIR}/include ${PROJECT_SOURCE_DIR})
if(BOLO_SANITIZE)
  target_compile_options(bolo_options INTERFACE -fsanitize=${BOLO_SANITIZE} -fno-omit-frame-pointer
                                                -fno-sanitize-recover=all)
  target_link_options(bolo_options INTERFACE -fsanitize=${BOLO_SANITIZE})
  # With sanitizers, GCC 12 warns about uninitialised values inside std::regex and similar templates.
  target_compile_options(bolo_options INTERFACE $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
endif()

# Sanitizers find as much without optimisation, in half the compile time: for folders that compute little.
if(BOLO_SANITIZE AND NOT BOLO_SANITIZE MATCHES "fuzzer")
  set(BOLO_LEAST_OPTIMISATION -O0)
endif()

# Unity builds parse shared headers once: a third of the time for a full build.
option(BOLO_UNITY "Compile the files of a library or test together" OFF)
set(CMAKE_UNITY_BUILD ${BOLO_UNITY})
set(CMAKE_UNITY_BUILD_BATCH_SIZE 12)
if(BOLO_UNITY)  # GCC takes a unity file for a header and warns about classes with members of file-local types
  target_compile_options(bolo_options INTERFACE $<$<COMPILE_LANG_AND_ID:CXX,GNU>:-Wno-subobject-linkage>)
endif()

# bolo_layer(NAME [ARITHMETIC] [SOURCES file...] DEPENDS layer... LIBRARIES target...)
# ARITHMETIC: reads no input from outside, and is built without BOLO_SANITIZE_LAYERS. SOURCES: default: all files of the
# folder. DEPENDS: layers of ours (without the bolo_ prefix). LIBRARIES: libraries that the layer's headers or sources
# use.
function(bolo_layer name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "ARITHMETIC" "" "SOURCES;DEPENDS;LIBRARIES")
  list(TRANSFORM arg_DEPENDS PREPEND bolo_)
  if(NOT arg_SOURCES)
    file(GLOB arg_SOURCES RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} CONFIGURE_DEPENDS *.cpp)
  endif()
  add_library(bolo_${name} STATIC ${arg_SOURCES})
  target_link_libraries(bolo_${name} PUBLIC ${arg_DEPENDS} ${arg_LIBRARIES} PRIVATE bolo_options)
  # Checks of every pointer double the compile time of code with large headers: also left out of tools and tests.
  if(BOLO_SANITIZE_LAYERS AND NOT arg_ARITHMETIC)
    target_compile_options(bolo_${name} PRIVATE -fsanitize=${BOLO_SANITIZE_LAYERS})
  endif()
  target_include_directories(bolo_${name} PUBLIC ${PROJECT_SOURCE_DIR}/include ${PROJECT_SOURCE_DIR})
endfunction()

# bolo_effect_list(TYPE TEMPLATE OUTPUT file...): generates the list of effects from a folder's files; NAME.cpp defines
# std::vector<TYPE> NAME_effects().
function(bolo_effect_list type template output)
  set(declarations "")
  set(names "")
  foreach(file IN LISTS ARGN)
    get_filename_component(name ${file} NAME_WE)
    string(APPEND declarations "std::vector<${type}> ${name}_effects();\n")
    string(APPEND names "    &${name}_effects,\n")
  endforeach()
  configure_file(${template} ${output} @ONLY)
endfunction()

# bolo_text(SYMBOL STEM.ENDING): makes the file available as the string SYMBOL by `#include "STEM_text.hpp"`.
function(bolo_text symbol file)
  get_filename_component(stem ${file} NAME_WE)
  file(READ ${file} text)
  set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
  file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/${stem}_text.hpp @ONLY
       CONTENT "#pragma once\n\ninline constexpr const char* @symbol@ = R\"(\n@text@)\";\n")
endfunction()
