# Debian's own hardening flags (dpkg-buildflags). Shipped programs are linked so that its tables are read-only
# and its place in memory is drawn at each start; BOLO_HARDENING compiles in the rest.
option(BOLO_HARDENING "Stack protector, fortified library calls" OFF)
if(CMAKE_BUILD_TYPE STREQUAL "Release")
  include(CheckPIESupported)
  check_pie_supported()
  add_link_options(-Wl,-z,relro -Wl,-z,now)
endif()
if(BOLO_HARDENING)
  add_compile_options(-fstack-protector-strong -fstack-clash-protection -Wformat -Werror=format-security)
  add_compile_definitions(_FORTIFY_SOURCE=2)
  add_compile_options(-ffile-prefix-map=${PROJECT_SOURCE_DIR}=.)  # no program names the folder that it was built in
endif()
