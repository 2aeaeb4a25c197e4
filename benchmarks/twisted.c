/* What a tridiagonal system costs on one thread, from one end or from both, and on two threads.
 *
 *     cc -O3 -march=native -pthread benchmarks/twisted.c -o twisted && ./twisted
 *
 * From both ends rows are eliminated to the middle, two rows are solved there, and the others are
 * substituted outwards: the same work, in which two divisions do not wait for each other. That is
 * what the package does on one thread. On two threads each takes an end, and they meet twice. The least
 * of many times is printed, because other processes may hold a core. An argument is that number.
 */
#define _GNU_SOURCE
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { MOST = 100000 };

static double diagonal[MOST], beside[MOST], right[MOST], factor[MOST], value[MOST];
static atomic_long started, eliminated[2], finished;
static int size;

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
}

/* Eliminate rows first, first + step, ... up to last; row i couples to i + 1 by beside[i]. */
static void eliminate(int first, int last, int step)
{
    double d = diagonal[first], r = right[first];
    for (int i = first; i != last; i += step) {
        double b = step > 0 ? beside[i] : beside[i - 1], w = b / d;
        factor[i] = w;
        value[i] = r / d;
        d = diagonal[i + step] - b * w;
        r = right[i + step] - b * value[i];
    }
    factor[last] = d;
    value[last] = r;
}

static void substitute(int first, int last, int step)
{
    for (int i = first; i != last; i -= step)
        value[i - step] -= factor[i - step] * value[i];
}

static void serial(void)
{
    eliminate(0, size - 1, 1);
    value[size - 1] /= factor[size - 1];
    substitute(size - 1, 0, 1);
}

/* Both halves on one thread, row by row in turn; the number of rows is even. */
static void both(void)
{
    int top = size / 2 - 1, below = size / 2;
    double d = diagonal[0], r = right[0], e = diagonal[size - 1], s = right[size - 1];
    for (int i = 0; i < top; i++) {
        int j = size - 1 - i;
        double b = beside[i], c = beside[j - 1], w = b / d, x = c / e;
        factor[i] = w;
        factor[j] = x;
        value[i] = r / d;
        value[j] = s / e;
        d = diagonal[i + 1] - b * w;
        e = diagonal[j - 1] - c * x;
        r = right[i + 1] - b * value[i];
        s = right[j - 1] - c * value[j];
    }
    double b = beside[top], determinant = d * e - b * b;
    value[top] = (e * r - b * s) / determinant;
    value[below] = (d * s - b * r) / determinant;
    for (int i = top; i > 0; i--) {
        int j = size - i;
        value[i - 1] -= factor[i - 1] * value[i];
        value[j] -= factor[j] * value[j - 1];
    }
}

/* One half of the rows, by thread 0 (the first half) or 1; round counts the solutions. */
static void half(int thread, long round)
{
    int top = size / 2 - 1, below = size / 2;
    if (thread == 0)
        eliminate(0, top, 1);
    else
        eliminate(size - 1, below, -1);
    atomic_store_explicit(&eliminated[thread], round, memory_order_release);
    while (atomic_load_explicit(&eliminated[1 - thread], memory_order_acquire) < round)
        ;
    /* both solve the two rows of the middle, and keep their own */
    double a = factor[top], c = factor[below], b = beside[top];
    double determinant = a * c - b * b, u = value[top], v = value[below];
    double own = thread == 0 ? (c * u - b * v) / determinant : (a * v - b * u) / determinant;
    atomic_fetch_add(&finished, 1); /* both have read the middle */
    while (atomic_load(&finished) < 2 * (2 * round - 1))
        ;
    if (thread == 0) {
        value[top] = own;
        substitute(top, 0, 1);
    } else {
        value[below] = own;
        substitute(below, size - 1, -1);
    }
    atomic_fetch_add(&finished, 1);
    while (atomic_load(&finished) < 2 * (2 * round))
        ;
}

static void *second(void *rounds)
{
    for (long round = 1; round <= *(long *)rounds; round++) {
        while (atomic_load_explicit(&started, memory_order_acquire) < round)
            ;
        half(1, round);
    }
    return NULL;
}

/* The largest error of a row with this solution, or what was found before if that is more. */
static double error(double away)
{
    for (int i = 0; i < size; i++) {
        double gap = diagonal[i] * value[i] - right[i];
        gap += i > 0 ? beside[i - 1] * value[i - 1] : 0.0;
        gap += i < size - 1 ? beside[i] * value[i + 1] : 0.0;
        away = gap > away ? gap : -gap > away ? -gap : away;
    }
    return away;
}

int main(int count, char **words)
{
    long most = count > 1 ? atol(words[1]) : 20000;
    puts("rows, one end [ns], both ends [ns], two threads [ns], largest error of a row");
    const int sizes[] = {10, 30, 100, 300, 1000, 10000, MOST};
    for (int which = 0; which < 7; which++) {
        size = sizes[which];
        for (int i = 0; i < size; i++) {
            diagonal[i] = 2.0;
            beside[i] = -0.9 - 0.1 * rand() / RAND_MAX;
            right[i] = 1.0 * rand() / RAND_MAX;
        }
        long rounds = 20000000 / size < most ? 20000000 / size : most;
        double one = 1.0, ends = 1.0, two = 1.0, away = 0.0;
        for (long k = 0; k < rounds; k++) {
            double begin = seconds();
            serial();
            double took = seconds() - begin;
            one = took < one ? took : one;
        }
        away = error(away);
        for (long k = 0; k < rounds; k++) {
            double begin = seconds();
            both();
            double took = seconds() - begin;
            ends = took < ends ? took : ends;
        }
        away = error(away);
        pthread_t helper;
        atomic_store(&started, 0), atomic_store(&finished, 0);
        atomic_store(&eliminated[0], 0), atomic_store(&eliminated[1], 0);
        pthread_create(&helper, NULL, second, &rounds);
        for (long round = 1; round <= rounds; round++) {
            double begin = seconds();
            atomic_store_explicit(&started, round, memory_order_release);
            half(0, round);
            double took = seconds() - begin;
            two = took < two ? took : two;
        }
        pthread_join(helper, NULL);
        away = error(away);
        printf("%d, %.0f, %.0f, %.0f, %.0e\n", size, 1e9 * one, 1e9 * ends, 1e9 * two, away);
    }
    return 0;
}
