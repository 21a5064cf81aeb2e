/* The same in C with nothing of this project but its IDL: a start for programs of your own.
 *
 *   idlc servotwin.idl && cc subscriber.c servotwin.c -lddsc -o subscriber
 *   subscriber MACHINE [DOMAIN [SILENCE_S]]
 */
#include <dds/dds.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "servotwin.h" /* made by idlc from msgs/servotwin.idl */

#define ROOM 64

/* The settings of the daemon if CYCLONEDDS_URI is not set: one host, no multicast. */
static const char* const loopback =
    "<General><Interfaces><NetworkInterface name=\"lo\" multicast=\"false\"/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>63</MaxAutoParticipantIndex>"
    "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery>";

static volatile sig_atomic_t asked_to_stop = 0;

static void stop(int signal_number) {
  (void)signal_number;
  asked_to_stop = 1;
}

static dds_entity_t must(dds_entity_t result, const char* what) {
  if (result >= 0) return result;
  fprintf(stderr, "subscriber: cannot %s: %s\n", what, dds_strretcode(result));
  exit(1);
}

static dds_entity_t prediction_reader(dds_entity_t participant, dds_duration_t silence) {
  const dds_entity_t topic = must(dds_create_topic(participant, &servotwin_msgs_Prediction_desc,
                                                   "servotwin/prediction", NULL, NULL),
                                  "make the topic");
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, ROOM);
  dds_qset_ownership(qos, DDS_OWNERSHIP_EXCLUSIVE); /* of two daemons, the one of more strength */
  dds_qset_deadline(qos, silence);
  const dds_entity_t reader = must(dds_create_reader(participant, topic, qos, NULL), "read");
  dds_delete_qos(qos);
  must(
      dds_set_status_mask(reader, DDS_DATA_AVAILABLE_STATUS | DDS_REQUESTED_DEADLINE_MISSED_STATUS |
                                      DDS_LIVELINESS_CHANGED_STATUS),
      "ask for the status");
  return reader;
}

/* The kinds of the axes are in the status, which late subscribers receive, too. */
static dds_entity_t status_reader(dds_entity_t participant) {
  const dds_entity_t topic = must(
      dds_create_topic(participant, &servotwin_msgs_Status_desc, "servotwin/status", NULL, NULL),
      "make the topic");
  dds_qos_t* qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 1);
  dds_qset_ownership(qos, DDS_OWNERSHIP_EXCLUSIVE);
  const dds_entity_t reader = must(dds_create_reader(participant, topic, qos, NULL), "read");
  dds_delete_qos(qos);
  return reader;
}

static bool rotary[servotwin_msgs_kMaxAxes];

static void look_at_axes(dds_entity_t reader, const char* machine) {
  void* samples[ROOM] = {NULL};
  dds_sample_info_t infos[ROOM];
  const int count = must(dds_take(reader, samples, infos, ROOM, ROOM), "take");
  for (int i = 0; i < count; ++i) {
    const servotwin_msgs_Status* status = samples[i];
    if (!infos[i].valid_data || strcmp(status->machine, machine) != 0) continue;
    for (uint32_t k = 0; k < status->rotary._length; ++k) rotary[k] = status->rotary._buffer[k];
  }
  if (count > 0) dds_return_loan(reader, samples, count);
}

static void print(const servotwin_msgs_Prediction* prediction) {
  printf("cycle %llu:", (unsigned long long)prediction->sequence_number);
  for (uint32_t i = 0; i < prediction->axes._length; ++i)
    printf(" axis %u %.3f %s,", i + 1, 1e6 * prediction->axes._buffer[i].predicted_error_m,
           rotary[i] ? "urad" : "um");
  printf(" contour %.3f um\n", 1e6 * prediction->contour_error_m);
}

enum heard { NOTHING_YET, SPEAKS, SILENT, GONE };

struct daemon_seen {
  enum heard heard;
  dds_time_t last;
};

static void take(dds_entity_t reader, const char* machine, struct daemon_seen* daemon) {
  void* samples[ROOM] = {NULL};
  dds_sample_info_t infos[ROOM];
  const int count = must(dds_take(reader, samples, infos, ROOM, ROOM), "take");
  for (int i = 0; i < count; ++i) {
    const servotwin_msgs_Prediction* prediction = samples[i];
    if (!infos[i].valid_data || strcmp(prediction->machine, machine) != 0) continue;
    const dds_time_t now = dds_time();
    if (daemon->heard == SILENT || daemon->heard == GONE)
      printf("again after %.3f s\n", 1e-9 * (double)(now - daemon->last));
    print(prediction);
    daemon->heard = SPEAKS;
    daemon->last = now;
  }
  if (count > 0) dds_return_loan(reader, samples, count);
}

static void notice_silence(dds_entity_t reader, double silence_s, struct daemon_seen* daemon) {
  dds_requested_deadline_missed_status_t deadline;
  dds_liveliness_changed_status_t liveliness;
  must(dds_get_requested_deadline_missed_status(reader, &deadline), "ask about the deadline");
  must(dds_get_liveliness_changed_status(reader, &liveliness), "ask who is alive");
  /* The deadline of another machine may have passed, too. */
  const int late = 1e-9 * (double)(dds_time() - daemon->last) > silence_s;
  if (daemon->heard == SPEAKS && deadline.total_count_change > 0 && late) {
    printf("silent: no prediction for more than %.3g s\n", silence_s);
    daemon->heard = SILENT;
  }
  if ((daemon->heard == SPEAKS || daemon->heard == SILENT) && liveliness.alive_count == 0) {
    puts("gone: no daemon is there");
    daemon->heard = GONE;
  }
}

int main(int argc, char** argv) {
  if (argc < 2 || argc > 4) {
    fputs("usage: subscriber MACHINE [DOMAIN [SILENCE_S]]\n", stderr);
    return 2;
  }
  char* end = "";
  const long domain_given = argc > 2 ? strtol(argv[2], &end, 10) : 0;
  if (*end != '\0' || (argc > 2 && end == argv[2]) || domain_given < 0 || domain_given > 230) {
    fprintf(stderr, "subscriber: DOMAIN = '%s': must be a whole number from 0 to 230\n", argv[2]);
    return 2;
  }
  const double silence_s = argc > 3 ? strtod(argv[3], &end) : 0.1;
  if (*end != '\0' || !(silence_s > 0.0)) {
    fprintf(stderr, "subscriber: SILENCE_S = '%s': must be a number above 0\n", argv[3]);
    return 2;
  }
  const dds_domainid_t domain = (dds_domainid_t)domain_given;
  signal(SIGINT, stop);
  signal(SIGTERM, stop);
  const char* configured = getenv("CYCLONEDDS_URI");
  if (configured == NULL || *configured == '\0')
    must(dds_create_domain(domain, loopback), "open the domain");
  const dds_entity_t participant =
      must(dds_create_participant(domain, NULL, NULL), "join the domain");
  const dds_entity_t reader = prediction_reader(participant, (dds_duration_t)(1e9 * silence_s));
  const dds_entity_t statuses = status_reader(participant);
  const dds_entity_t waitset = must(dds_create_waitset(participant), "wait");
  must(dds_waitset_attach(waitset, reader, 0), "wait");

  struct daemon_seen daemon = {NOTHING_YET, 0};
  while (!asked_to_stop) {
    dds_waitset_wait(waitset, NULL, 0, DDS_MSECS(100));
    uint32_t data = 0;
    must(dds_take_status(reader, &data, DDS_DATA_AVAILABLE_STATUS), "ask for the status");
    look_at_axes(statuses, argv[1]);
    take(reader, argv[1], &daemon);
    notice_silence(reader, silence_s, &daemon);
    fflush(stdout);
  }
  dds_delete(DDS_CYCLONEDDS_HANDLE);
  return 0;
}
