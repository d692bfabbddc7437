# Debian's own hardening flags (dpkg-buildflags). Shipped programs are always linked with RELRO and as
# position-independent executables; BOLO_HARDENING adds the compiler's flags.
option(BOLO_HARDENING "Stack protector, fortified library calls" OFF)
if(CMAKE_BUILD_TYPE STREQUAL "Release")
  include(CheckPIESupported)
  check_pie_supported()
  add_link_options(-Wl,-z,relro -Wl,-z,now)
endif()
if(BOLO_HARDENING)
  add_compile_options(-fstack-protector-strong -fstack-clash-protection -Wformat -Werror=format-security)
  add_compile_definitions(_FORTIFY_SOURCE=2)
  add_compile_options(-ffile-prefix-map=${PROJECT_SOURCE_DIR}=.)  # programs do not contain the path of the build folder
endif()
