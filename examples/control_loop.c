/* Read the encoders behind a serial port every 2 ms, and act as the controller in arm.h does.
 * The chain has two rods and one motor, at the pivot (joint 0); `to_c` has `relative=True`.
 *
 *     cc -std=c99 -O2 -ffp-contract=off -I. examples/control_loop.c -o control_loop
 *     ./control_loop PORT timing.csv
 */
#define _POSIX_C_SOURCE 200112L
#include <stdio.h>
#include <time.h>

#include "arm.h"

#if ARM_RODS != 2 || ARM_JOINTS != 1 || ARM_MOTOR != 0 || ARM_CART || !ARM_RELATIVE
#error "control_loop.c needs a chain of two rods with one motor, at the pivot, and relative=True"
#endif

#define PERIOD 0.002 /* s */
#define TICKS 3000
#define TURN 6.28318530717958623
#define COUNTS 4096
#define TIME_CONSTANT 0.003 /* s, of the estimated velocities */

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static void sleep_until(double time)
{
    const double left = time - now();
    struct timespec pause;
    if (left <= 0.0)
        return;
    pause.tv_sec = (time_t)left;
    pause.tv_nsec = (long)(1e9 * (left - (double)pause.tv_sec));
    nanosleep(&pause, 0);
}

int main(int count, char **names)
{
    static arm_controller controller;
    static arm_estimator encoders[ARM_RODS];
    FILE *in = count == 3 ? fopen(names[1], "r") : 0, *out = in ? fopen(names[1], "w") : 0;
    FILE *csv = out ? fopen(names[2], "w") : 0;
    double angle[ARM_RODS], velocity[ARM_RODS], torque[ARM_JOINTS] = {0.0}, clock = 0.0;
    double due, woken;
    int tick, i;
    if (!csv)
        return 1;
    fprintf(csv, "time,late,busy,theta0,theta1,tau0\n");
    arm_controller_reset(&controller);
    for (i = 0; i < ARM_RODS; i++)
        arm_estimate_reset(&encoders[i]);
    for (tick = 0, due = now(); tick < TICKS; tick++, due += PERIOD) {
        const double before = clock;
        unsigned long microseconds;
        int counts[ARM_RODS];
        sleep_until(due);
        woken = now();
        if (fscanf(in, "%lu", &microseconds) != 1)
            return 1;
        clock = 1e-6 * (double)microseconds;
        for (i = 0; i < ARM_RODS; i++) {
            if (fscanf(in, "%d", &counts[i]) != 1)
                return 1;
            angle[i] = counts[i] * (TURN / COUNTS);
            velocity[i] = arm_estimate(&encoders[i], angle[i], clock - before, TIME_CONSTANT, TURN);
        }
        if (tick % (int)(ARM_DT / PERIOD + 0.5) == 0)
            arm_controller_act(&controller, angle, velocity, 0, torque);
        if (!(torque[0] >= -arm_limits[0] && torque[0] <= arm_limits[0]))
            torque[0] = 0.0; /* what is not a number must not reach a motor */
        fprintf(out, "%.17g\n", torque[0]);
        fflush(out);
        fprintf(csv, "%.6f,%.9f,%.9f,%.6f,%.6f,%.6f\n", clock, woken - due, now() - woken,
            encoders[0].angle, encoders[0].angle + encoders[1].angle, torque[0]);
        if (woken > due + PERIOD)
            due = woken; /* a period was missed: the next begins now */
    }
    fprintf(out, "stop\n");
    fclose(csv);
    return fclose(out);
}
