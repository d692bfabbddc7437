# Installation. Each component becomes one Debian package (cmake/packaging.cmake); the client's libraries and the Python
# module are installed by drivers/shm. Units, rules and settings go below the prefix, configuration to /etc.

install(TARGETS bolo bolod RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT bolo)

# All targets that packages contain.
add_custom_target(shipped DEPENDS bolo bolod bolo_client)
foreach(optional manual gstbolo bolo-ros2)
  if(TARGET ${optional})
    add_dependencies(shipped ${optional})
  endif()
endforeach()

install(FILES config/a655sc.toml config/boson.toml config/lepton.toml config/bolod.toml config/demo.toml
  DESTINATION ${CMAKE_INSTALL_FULL_SYSCONFDIR}/bolo COMPONENT bolo)

set(systemd_files ${PROJECT_SOURCE_DIR}/systemd)
install(FILES ${systemd_files}/bolod@.service ${systemd_files}/bolo-fakecam.service
  DESTINATION lib/systemd/system COMPONENT bolo)
install(FILES ${systemd_files}/sysusers.conf DESTINATION lib/sysusers.d RENAME bolo.conf COMPONENT bolo)
install(FILES ${systemd_files}/sysctl.conf DESTINATION lib/sysctl.d RENAME 00-bolo.conf COMPONENT bolo)
install(FILES ${systemd_files}/bolo-v4l2loopback.conf DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/bolo COMPONENT bolo)
install(FILES ${systemd_files}/60-bolo-usb.rules DESTINATION lib/udev/rules.d COMPONENT bolo)

if(TARGET manual)  # not built with sanitizers
  install(DIRECTORY ${BOLO_MANUAL}/ DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/man COMPONENT bolo
    FILES_MATCHING PATTERN "*.gz")
endif()
set(completion ${PROJECT_SOURCE_DIR}/tools/manual)
foreach(program bolo bolod)  # bash looks up completions by the program's name
  install(FILES ${completion}/bolo.bash
    DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/bash-completion/completions RENAME ${program} COMPONENT bolo)
endforeach()
install(FILES ${completion}/_bolo DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/zsh/vendor-completions COMPONENT bolo)
install(FILES ${completion}/bolo.fish DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/fish/vendor_completions.d COMPONENT bolo)

install(FILES config/grafana.json DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/bolo COMPONENT bolo)

install(FILES README.md ARCHITECTURE.md CONTRIBUTING.md SECURITY.md CHANGELOG.md
  DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT bolo)
install(DIRECTORY docs DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT bolo)
install(FILES tools/slurm/bolo-deblur.sbatch DESTINATION ${CMAKE_INSTALL_DOCDIR}/examples COMPONENT bolo)
