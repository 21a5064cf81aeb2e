#include "cli/program/manual_text.h"

namespace servotwin::cli {

ManualText servotwin_manual_text() {
  return {
      .section = 1,
      .book = "User Commands",
      .title = "model, predict and diagnose servo drives from recordings",
      .before = {{
          .title = "Description",
          .paragraphs =
              {"servotwin builds a digital twin of the servo drives of a CNC machine. From a "
               "recording of commanded and actual positions it identifies a model of an axis: "
               "the position loop, friction and vibration. With the model it predicts the "
               "tracking error from the commands alone, names the physical causes of errors that "
               "the model does not predict, and learns corrections of a path. It also plays "
               "recordings to the daemon servotwind(8) and shows what the daemon publishes.",
               "A command prints a report for people on standard output and writes results to "
               "the files that its options name. The name - stands for standard output; the "
               "report then goes to standard error. A result is written as a whole or not at "
               "all.",
               "The value of an option follows as the next word or after an equals sign: "
               "--axis X or --axis=X."},
          .entries = {},
          .examples = {},
      }},
      .after =
          {{
               .title = "Exit status",
               .paragraphs = {},
               .entries = {{"0", "The command did its work."},
                           {"1",
                            "The work failed. A line on standard error for each problem says what "
                            "failed and what to do."},
                           {"2",
                            "The command line is wrong. One line on standard error says where."}},
               .examples = {},
           },
           {
               .title = "Environment",
               .paragraphs = {},
               .entries = {{"CYCLONEDDS_URI",
                            "Configuration of Cyclone DDS. Without it, DDS uses only the "
                            "loopback interface of this host."},
                           {"STATE_DIRECTORY, XDG_STATE_HOME, HOME",
                            "Where history looks for the store without --store: in "
                            "STATE_DIRECTORY, else in servotwin/ of XDG_STATE_HOME, else in "
                            "~/.local/state/servotwin."}},
               .examples = {},
           },
           {
               .title = "Files",
               .paragraphs = {},
               .entries =
                   {{"recording",
                     "A CSV table with one row per cycle. Every column name carries its unit: "
                     "time[s],X.command[mm],X.actual[mm],X.torque[Nm]. Columns with other names "
                     "are assigned with --columns. servotwin formats lists the other formats."},
                    {"model file",
                     "JSON of the schema servotwin.model/1. identify writes it; most other "
                     "commands read it."},
                    {"/var/lib/servotwin/servotwin.sqlite",
                     "The store of the daemon: models, diagnoses and events."}},
               .examples = {},
           },
           {
               .title = "Examples",
               .paragraphs = {},
               .entries = {},
               .examples =
                   {{"Identify a model of axis X, with its friction:",
                     "servotwin identify monday.csv --axis X --model x.json"},
                    {"Compare its prediction with another recording:",
                     "servotwin predict tuesday.csv --axis X --model x.json"},
                    {"Find out what has changed since then:",
                     "servotwin diagnose today.csv --axis X --model x.json --report x.html"},
                    {"Correct a path of two axes in advance:",
                     "servotwin learn path.csv --model x.json --model y.json "
                     "--out corrected.csv"},
                    {"Play a recording to the daemon of a machine:",
                     "servotwin replay monday.csv --dds --machine mill-7"},
                    {"Check a configuration before the daemon reads it:",
                     "servotwin check-config /etc/servotwin/servotwind.toml"},
                    {"Switch completion on in a shell where no package has installed it:",
                     "source <(servotwin completion bash)"}},
           }},
      .see_also = {"servotwind(8)"},
  };
}

ManualText servotwind_manual_text() {
  return {
      .section = 8,
      .book = "System Administration",
      .title = "digital twin of the servo drives of a machine",
      .before = {{
          .title = "Description",
          .paragraphs =
              {"servotwind follows one machine. In every cycle it predicts the tracking error of "
               "each axis from the commands and compares it with the encoder. Meanwhile, at idle "
               "priority, it records the motion, identifies new models and diagnoses the axes. A "
               "new model replaces the one in force only if it predicts better on motion that "
               "neither model was fitted to.",
               "The daemon reads cycles from DDS, from a CAN bus or from recordings, publishes "
               "its predictions over DDS, and serves a web page and an HTTP interface. It sends "
               "nothing to a drive unless that is configured and armed.",
               "An option takes precedence over the configuration."},
          .entries = {},
          .examples = {},
      }},
      .after =
          {{
               .title = "Signals",
               .paragraphs = {},
               .entries =
                   {{"SIGTERM, SIGINT",
                     "Stop. The daemon first processes the samples that it has received and "
                     "finishes an identification that is running."},
                    {"SIGHUP",
                     "Read the configuration again. These keys take effect at once: all of "
                     "[identify]; every_s, record_s and encoder_in_loop of [diagnose]; "
                     "recordings_mb and recordings_max_mb of [store]. The log names other "
                     "changes, which need a restart. If the new configuration has an error, the "
                     "old one stays in force and the log has a line for each problem. No sample "
                     "is lost."}},
               .examples = {},
           },
           {
               .title = "Exit status",
               .paragraphs = {},
               .entries = {{"0", "Stopped as asked, or all recordings are replayed."},
                           {"1",
                            "The daemon could not start. Standard error has a line for each "
                            "problem."},
                           {"2", "The command line is wrong."}},
               .examples = {},
           },
           {
               .title = "Environment",
               .paragraphs = {},
               .entries = {{"STATE_DIRECTORY, XDG_STATE_HOME, HOME",
                            "Where the store is if neither option nor configuration names it: "
                            "in STATE_DIRECTORY, which systemd sets, else in servotwin/ of "
                            "XDG_STATE_HOME, else in ~/.local/state/servotwin."},
                           {"CYCLONEDDS_URI",
                            "Configuration of Cyclone DDS. Without it, DDS uses only the "
                            "loopback interface of this host."}},
               .examples = {},
           },
           {
               .title = "Files",
               .paragraphs = {},
               .entries = {{"/etc/servotwin/servotwind.toml",
                            "Configuration of servotwind.service."},
                           {"/etc/servotwin/NAME.toml",
                            "Configuration of servotwind@NAME.service, for several machines on one "
                            "host."},
                           {"/var/lib/servotwin, /var/lib/servotwin-NAME",
                            "The stores of these services: models, diagnoses and events in "
                            "servotwin.sqlite, and recordings."}},
               .examples = {},
           },
           {
               .title = "Journal",
               .paragraphs = {"Under systemd, the entries of the log have the fields MACHINE, "
                              "AXIS, EVENT and DETAIL."},
               .entries = {},
               .examples = {{"New models of axis X:",
                             "journalctl -u servotwind EVENT=model_promoted AXIS=X"},
                            {"Warnings and errors:", "journalctl -u servotwind -p warning"}},
           }},
      .see_also = {"servotwin(1)", "systemd.service(5)"},
  };
}

}  // namespace servotwin::cli
