/* The estimator's two hot parts in C: one step of the three-model filter, and the closing of an element.
 *
 * The limit for the columns of numpy: the same layout (24 block-upper rows, lanes last), the same formulas in the same
 * order, eight lanes at a time so that the compiler makes vectors of the inner loops. See manoeuvre.py, kalman.py,
 * coordinated_turn.py and estimator.py, whose numbers it must give.  gcc -O3 -march=native -shared -fPIC
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define L 8
#define EACH for (int l = 0; l < L; l++)
#define MODELS 3
typedef double V[L];

/* Rows of the 2x2 blocks: 1 position, 2 velocity, 3 acceleration. */
#define P11(i, j) P[6 * (i) + (j)]
#define P12(i, j) P[6 * (i) + 2 + (j)]
#define P13(i, j) P[6 * (i) + 4 + (j)]
#define P22(i, j) P[12 + 4 * (i) + (j)]
#define P23(i, j) P[14 + 4 * (i) + (j)]
#define P33(i, j) P[20 + 2 * (i) + (j)]

static int row_of(int i, int j) {
    if (i / 2 > j / 2) { int k = i; i = j; j = k; }
    return i < 2 ? 6 * i + j : i < 4 ? 12 + 4 * (i - 2) + j - 2 : 20 + 2 * (i - 4) + j - 4;
}

static void predict(V *x, V *P, const double *h, const double *q) {
    V g;
    EACH g[l] = 0.5 * h[l] * h[l];
    for (int i = 0; i < 2; i++) EACH {
        x[i][l] += h[l] * x[2 + i][l] + g[l] * x[4 + i][l];
        x[2 + i][l] += h[l] * x[4 + i][l];
    }
    for (int i = 0; i < 2; i++) for (int j = 0; j < 2; j++) EACH P11(i, j)[l] += h[l] * P12(j, i)[l] + g[l] * P13(j, i)[l];
    for (int i = 0; i < 2; i++) for (int j = 0; j < 2; j++) EACH P12(i, j)[l] += h[l] * P22(i, j)[l] + g[l] * P23(j, i)[l];
    for (int i = 0; i < 2; i++) for (int j = 0; j < 2; j++) EACH {
        P22(i, j)[l] += h[l] * P23(j, i)[l];
        P13(i, j)[l] += h[l] * P23(i, j)[l] + g[l] * P33(i, j)[l];
    }
    for (int i = 0; i < 2; i++) for (int j = 0; j < 2; j++) EACH {
        P23(i, j)[l] += h[l] * P33(i, j)[l];
        P11(i, j)[l] += h[l] * P12(i, j)[l] + g[l] * P13(i, j)[l];
        P12(i, j)[l] += h[l] * P13(i, j)[l];
        P22(i, j)[l] += h[l] * P23(i, j)[l];
    }
    EACH { P11(1, 0)[l] = P11(0, 1)[l]; P22(1, 0)[l] = P22(0, 1)[l]; }
    for (int i = 0; i < 2; i++) EACH {
        double a = q[l] * h[l], b = a * h[l], c = b * h[l];
        P11(i, i)[l] += c * h[l] * h[l] / 20.0;
        P12(i, i)[l] += c * h[l] / 8.0;
        P13(i, i)[l] += c / 6.0;
        P22(i, i)[l] += c / 3.0;
        P23(i, i)[l] += b / 2.0;
        P33(i, i)[l] += a;
    }
}

typedef struct { V a0[6], a1[6], m0, m1, h00, h10, h11; } Gains;
typedef struct { V a0[6], a1[6], n0, n1, c00, ell, s, d2; } Innovation;

static void innovate(Innovation *v, V *x, V *P, int first, const double *z0, const double *z1, V r00, V r01, V r11) {
    for (int i = 0; i < 6; i++) {
        memcpy(v->a0[i], P[row_of(first, i)], sizeof(V));
        memcpy(v->a1[i], P[row_of(first + 1, i)], sizeof(V));
    }
    EACH {
        double c00 = v->a0[first][l] + r00[l], c01 = v->a0[first + 1][l] + r01[l], c11 = v->a1[first + 1][l] + r11[l];
        double n0 = z0[l] - x[first][l], n1 = z1[l] - x[first + 1][l], ell = c01 / c00, s = c11 - ell * c01, m = n1 - ell * n0;
        v->n0[l] = n0; v->n1[l] = n1; v->c00[l] = c00; v->ell[l] = ell; v->s[l] = s;
        v->d2[l] = n0 * n0 / c00 + m * m / s;
    }
}

static void apply(V *x, V *P, Innovation *v, const double *ok, Gains *g) {
    EACH {
        g->h00[l] = sqrt(ok[l] / v->c00[l]);
        g->h11[l] = sqrt(ok[l] / v->s[l]);
        g->h10[l] = -v->ell[l] * g->h11[l];
        g->m0[l] = g->h00[l] * v->n0[l];
        g->m1[l] = g->h11[l] * (v->n1[l] - v->ell[l] * v->n0[l]);
    }
    for (int i = 0; i < 6; i++) EACH {
        g->a1[i][l] = g->h11[l] * (v->a1[i][l] - v->ell[l] * v->a0[i][l]);
        g->a0[i][l] = g->h00[l] * v->a0[i][l];
        x[i][l] += g->a0[i][l] * g->m0[l] + g->a1[i][l] * g->m1[l];
    }
    for (int i = 0; i < 6; i++) for (int j = 2 * (i / 2); j < 6; j++) {
        double *p = P[row_of(i, j)];
        EACH p[l] -= g->a0[i][l] * g->a0[j][l] + g->a1[i][l] * g->a1[j][l];
    }
}

static void reweigh(V *mu, Innovation *v, const double *ok) {
    V ll[MODELS], top, sum;
    for (int m = 0; m < MODELS; m++) EACH ll[m][l] = -0.5 * (v[m].d2[l] + log(v[m].c00[l] * v[m].s[l]));
    EACH { top[l] = fmax(fmax(ll[0][l], ll[1][l]), ll[2][l]); sum[l] = 0.0; }
    for (int m = 0; m < MODELS; m++) EACH { ll[m][l] = mu[m][l] * exp(ll[m][l] - top[l]); sum[l] += ll[m][l]; }
    for (int m = 0; m < MODELS; m++) EACH ll[m][l] = fmax(ll[m][l] / sum[l], 1e-6);
    EACH sum[l] = ll[0][l] + ll[1][l] + ll[2][l];
    for (int m = 0; m < MODELS; m++) EACH if (ok[l] > 0.0) mu[m][l] = ll[m][l] / sum[l];
}

/* Given by the caller, so that they stand in one place only. */
static double RATES[3][3], JERK[3], STEADY, HELD, WANDER, NEGLIGIBLE, GATE, DOUBT, SIGMAS, NARROW, WIDE, HOVER, SLOWEST, TURN_MIN, RATE_MAX;
static double SMALL, ALONG_SHARE, ACROSS_SHARE, LEAST_TURN, LEAST_UPDATE, MOST_UPDATE;
static int TURNS;

void configure(const double *rates, const double *jerk, const double *rest) {
    memcpy(RATES, rates, sizeof RATES);
    memcpy(JERK, jerk, sizeof JERK);
    STEADY = rest[0]; GATE = rest[1]; SIGMAS = rest[2]; NARROW = rest[3]; WIDE = rest[4]; HOVER = rest[5];
    SLOWEST = rest[6]; TURN_MIN = rest[7]; RATE_MAX = rest[8]; ALONG_SHARE = rest[9]; ACROSS_SHARE = rest[10];
    TURNS = rest[11] > 0.0; SMALL = rest[12]; WANDER = rest[13]; LEAST_TURN = rest[14]; LEAST_UPDATE = rest[15];
    MOST_UPDATE = rest[16]; HELD = rest[17]; NEGLIGIBLE = rest[18];
    DOUBT = SIGMAS * SIGMAS;
}

/* Unit vector to the left of a velocity; zero where there is no direction. */
static void across_of(const double *ve, const double *vn, double *e, double *n) {
    EACH {
        double speed = hypot(ve[l], vn[l]), one = (speed >= SLOWEST) / fmax(speed, SLOWEST);
        e[l] = -vn[l] * one; n[l] = ve[l] * one;
    }
}

static double turn_rate(V *x, int l) {
    double square = fmax(x[2][l] * x[2][l] + x[3][l] * x[3][l], TURN_MIN * TURN_MIN);
    return fmin(fmax((x[2][l] * x[5][l] - x[3][l] * x[4][l]) / square, -RATE_MAX), RATE_MAX);
}

/* White jerk: some power either way, and more across the flight. */
static void jerk(V *P, const double *h, const double *even, const double *power, const double *e, const double *n) {
    EACH {
        double ee = e[l] * e[l], nn = n[l] * n[l], aimless = 0.5 * (1.0 - ee - nn), more = power[l];
        double N[2][2] = {{even[l] + more * (ee + aimless), more * (e[l] * n[l])}, {more * (e[l] * n[l]), even[l] + more * (nn + aimless)}};
        double h2 = h[l] * h[l], w[5] = {h2 * h2 / 20.0, h2 * h[l] / 8.0, h2 / 6.0, h2 / 3.0, 0.5 * h[l]};
        for (int i = 0; i < 2; i++) for (int j = 0; j < 2; j++) {
            P11(i, j)[l] += w[0] * N[i][j]; P12(i, j)[l] += w[1] * N[i][j]; P13(i, j)[l] += w[2] * N[i][j];
            P22(i, j)[l] += w[3] * N[i][j]; P23(i, j)[l] += w[4] * N[i][j]; P33(i, j)[l] += N[i][j];
        }
    }
}

/* Two rows (or columns) of a block times a turn: same times the unit matrix and left times a quarter turn. */
#define TURNED(p, q, same, left) { double u = (p)[l], v = (q)[l]; (p)[l] = (same) * u - (left) * v; (q)[l] = (left) * u + (same) * v; }

/* Turns the errors of the acceleration, and of the velocity, by an angle. */
static void turn_errors(V *P, const double *c, const double *s, int velocity) {
    for (int i = 0; i < 2; i++) EACH {
        TURNED(P13(i, 0), P13(i, 1), c[l], s[l])
        TURNED(P23(i, 0), P23(i, 1), c[l], s[l])
    }
    for (int i = 0; i < 2; i++) EACH TURNED(P33(0, i), P33(1, i), c[l], s[l])
    for (int i = 0; i < 2; i++) EACH TURNED(P33(i, 0), P33(i, 1), c[l], s[l])
    if (velocity) {
        for (int i = 0; i < 2; i++) EACH {
            TURNED(P12(i, 0), P12(i, 1), c[l], s[l])
            TURNED(P23(0, i), P23(1, i), c[l], s[l])
            TURNED(P22(0, i), P22(1, i), c[l], s[l])
        }
        for (int i = 0; i < 2; i++) EACH TURNED(P22(i, 0), P22(i, 1), c[l], s[l])
        EACH P22(1, 0)[l] = P22(0, 1)[l];
    }
    EACH P33(1, 0)[l] = P33(0, 1)[l];
}

/* Cosine and sine of the angle by which the acceleration turned are left for the way back. */
static void turn(V *x, V *P, const double *h, const double *along, const double *across, V *turned) {
    V e, n, ae, an, even, more, step[3][2];
    across_of(x[2], x[3], e, n);
    EACH {
        double rate = turn_rate(x, l), angle = rate * h[l], s = sin(angle), t = sin(0.5 * angle), less = 2.0 * t * t, half = 0.5 * h[l] * h[l];
        int small = fabs(angle) < SMALL;
        step[0][0][l] = small ? 0.0 : less / (rate * rate) - half;
        step[0][1][l] = small ? angle * half / 3.0 : (angle - s) / (rate * rate);
        step[1][0][l] = small ? 0.0 : s / rate - h[l];
        step[1][1][l] = small ? angle * 0.5 * h[l] : less / rate;
        step[2][0][l] = -less;
        step[2][1][l] = s;
        turned[0][l] = fabs(angle) > LEAST_TURN ? cos(angle) : 1.0;
        turned[1][l] = fabs(angle) > LEAST_TURN ? s : 0.0;
        ae[l] = x[4][l]; an[l] = x[5][l]; even[l] = 0.0;
    }
    predict(x, P, h, even);
    for (int k = 0; k < 3; k++) EACH {
        x[2 * k][l] += step[k][0][l] * ae[l] - step[k][1][l] * an[l];
        x[2 * k + 1][l] += step[k][0][l] * an[l] + step[k][1][l] * ae[l];
    }
    turn_errors(P, turned[0], turned[1], 0);
    EACH { even[l] = along[l] * h[l]; more[l] = (across[l] - along[l]) * h[l]; }
    jerk(P, h, even, more, e, n);
}

/* A circle at constant speed, where time passes: position, velocity and turn rate move, the acceleration follows. */
static void circle(V *x, V *P, const double *h, double across) {
    static V none; /* of zeros */
    V before_x[6], before_P[24], ce, cn, e, n, power;
    memcpy(before_x, x, sizeof before_x); memcpy(before_P, P, sizeof before_P);
    EACH {
        double ve = x[2][l], vn = x[3][l], square = ve * ve + vn * vn, w = turn_rate(x, l);
        double free = (fabs(w) < RATE_MAX) / fmax(square, TURN_MIN * TURN_MIN), longer = square < TURN_MIN * TURN_MIN ? 0.0 : 2.0 * w;
        double gv[2] = {(x[5][l] - longer * ve) * free, (-x[4][l] - longer * vn) * free}, ga[2] = {-vn * free, ve * free};
        double half = 0.5 * w * h[l], mc = cos(half), t = sin(half), c = mc * mc - t * t, s = 2.0 * mc * t;
        double size = fmax(fabs(half), SMALL), u = sin(size) / size, by = half * (cos(size) - u) / (2.0 * size * size);
        double same = h[l] * u * mc, left = h[l] * u * t;
        double same_w = h[l] * h[l] * (by * mc - 0.5 * u * t), left_w = h[l] * h[l] * (by * t + 0.5 * u * mc);
        double p11[2][2], p12[2][2], p22[2][2], wp[2], wv[2], wa[2], ww = 0.0;
        for (int i = 0; i < 2; i++) {
            wp[i] = P12(i, 0)[l] * gv[0] + P12(i, 1)[l] * gv[1] + P13(i, 0)[l] * ga[0] + P13(i, 1)[l] * ga[1];
            wv[i] = P22(i, 0)[l] * gv[0] + P22(i, 1)[l] * gv[1] + P23(i, 0)[l] * ga[0] + P23(i, 1)[l] * ga[1];
            wa[i] = P23(0, i)[l] * gv[0] + P23(1, i)[l] * gv[1] + P33(i, 0)[l] * ga[0] + P33(i, 1)[l] * ga[1];
        }
        for (int i = 0; i < 2; i++) ww += gv[i] * wv[i] + ga[i] * wa[i];
        double dp[2] = {same_w * ve - left_w * vn, left_w * ve + same_w * vn};
        x[0][l] += same * ve - left * vn; x[1][l] += left * ve + same * vn;
        x[2][l] = c * ve - s * vn; x[3][l] = s * ve + c * vn;
        double J[2] = {-x[3][l], x[2][l]}, dv[2] = {h[l] * J[0], h[l] * J[1]};
        x[4][l] = w * J[0]; x[5][l] = w * J[1];
        double pv[2][2], pw[2], tv[2] = {c * wv[0] - s * wv[1], s * wv[0] + c * wv[1]}, vw[2];
        double sv[2] = {same * wv[0] - left * wv[1], left * wv[0] + same * wv[1]};
        for (int j = 0; j < 2; j++) {
            pv[0][j] = P12(0, j)[l] + same * P22(0, j)[l] - left * P22(1, j)[l] + dp[0] * wv[j];
            pv[1][j] = P12(1, j)[l] + left * P22(0, j)[l] + same * P22(1, j)[l] + dp[1] * wv[j];
            pw[j] = wp[j] + sv[j] + dp[j] * ww;
            vw[j] = tv[j] + dv[j] * ww;
        }
        for (int i = 0; i < 2; i++) for (int j = 0; j < 2; j++) {
            double along = i ? left * P12(j, 0)[l] + same * P12(j, 1)[l] : same * P12(j, 0)[l] - left * P12(j, 1)[l];
            double back = j ? left * pv[i][0] + same * pv[i][1] : same * pv[i][0] - left * pv[i][1];
            p11[i][j] = P11(i, j)[l] + along + dp[i] * wp[j] + back + pw[i] * dp[j];
            p12[i][j] = (j ? s * pv[i][0] + c * pv[i][1] : c * pv[i][0] - s * pv[i][1]) + pw[i] * dv[j];
            double r0 = i ? s * P22(0, 0)[l] + c * P22(1, 0)[l] : c * P22(0, 0)[l] - s * P22(1, 0)[l];
            double r1 = i ? s * P22(0, 1)[l] + c * P22(1, 1)[l] : c * P22(0, 1)[l] - s * P22(1, 1)[l];
            p22[i][j] = (j ? s * r0 + c * r1 : c * r0 - s * r1) + tv[i] * dv[j] + dv[i] * vw[j];
        }
        p11[1][0] = p11[0][1]; p22[1][0] = p22[0][1];
        for (int i = 0; i < 2; i++) for (int j = 0; j < 2; j++) { P11(i, j)[l] = p11[i][j]; P12(i, j)[l] = p12[i][j]; P22(i, j)[l] = p22[i][j]; }
        double wr[2] = {-w * vw[1] + ww * J[0], w * vw[0] + ww * J[1]}, p23[2][2];
        for (int i = 0; i < 2; i++) {
            P13(i, 0)[l] = -w * p12[i][1] + pw[i] * J[0]; P13(i, 1)[l] = w * p12[i][0] + pw[i] * J[1];
            P23(i, 0)[l] = p23[i][0] = -w * p22[i][1] + vw[i] * J[0]; P23(i, 1)[l] = p23[i][1] = w * p22[i][0] + vw[i] * J[1];
        }
        for (int j = 0; j < 2; j++) { P33(0, j)[l] = -w * p23[1][j] + J[0] * wr[j]; P33(1, j)[l] = w * p23[0][j] + J[1] * wr[j]; }
        P33(1, 0)[l] = P33(0, 1)[l];
        ce[l] = mc * x[2][l] + t * x[3][l]; cn[l] = -t * x[2][l] + mc * x[3][l];
        power[l] = across * h[l];
    }
    across_of(ce, cn, e, n);
    jerk(P, h, none, power, e, n);
    EACH if (!(h[l] > 0.0)) {
        for (int i = 0; i < 6; i++) x[i][l] = before_x[i][l];
        for (int i = 0; i < 24; i++) P[i][l] = before_P[i][l];
    }
}

/* An update across turns the flight; it does not speed it up. */
static void keep_speed(V *x, V *P, const double *ve, const double *vn) {
    V c, s;
    EACH {
        double speed = hypot(ve[l], vn[l]), across = ve[l] * x[3][l] - vn[l] * x[2][l], angle = 0.0;
        double fast = fmax(speed, TURN_MIN), size = fabs(across) / (fast * fast);
        if (size > LEAST_UPDATE && size < MOST_UPDATE && speed >= TURN_MIN) angle = across / (speed * speed);
        c[l] = cos(angle); s[l] = sin(angle);
        if (angle != 0.0) {
            double fe = ve[l] / speed, fn = vn[l] / speed, reached = fe * x[2][l] + fn * x[3][l];
            x[2][l] = reached * (c[l] * fe - s[l] * fn); x[3][l] = reached * (s[l] * fe + c[l] * fn);
            TURNED(x[4], x[5], c[l], s[l])
        }
    }
    turn_errors(P, c, s, 1);
}

static void mix(V x[MODELS][6], V P[MODELS][24], V *mu, const double *h) {
    V T[3][3], c[3], W[3][3], d[3][6], y[6], Q[24];
    static const int A[3] = {0, 0, 1}, B[3] = {1, 2, 2};
    for (int i = 0; i < 3; i++) {
        V rest;
        EACH rest[l] = 1.0;
        for (int j = 0; j < 3; j++) if (j != i) EACH { T[i][j][l] = RATES[i][j] * h[l] / (1.0 + 2.0 * RATES[i][j] * h[l]); rest[l] -= T[i][j][l]; }
        EACH T[i][i][l] = rest[l];
    }
    for (int j = 0; j < 3; j++) EACH c[j][l] = T[0][j][l] * mu[0][l] + T[1][j][l] * mu[1][l] + T[2][j][l] * mu[2][l];
    for (int i = 0; i < 3; i++) for (int j = 0; j < 3; j++) EACH W[i][j][l] = T[i][j][l] * mu[i][l] / c[j][l];
    if (NEGLIGIBLE > 0.0) for (int j = 0; j < 3; j++) EACH {
        double sum = 0.0;
        for (int i = 0; i < 3; i++) { W[i][j][l] *= W[i][j][l] >= NEGLIGIBLE; sum += W[i][j][l]; }
        for (int i = 0; i < 3; i++) W[i][j][l] /= sum;
    }
    for (int k = 0; k < 3; k++) for (int i = 0; i < 6; i++) EACH d[k][i][l] = x[A[k]][i][l] - x[B[k]][i][l];
    V mixed[MODELS][6], spread[MODELS][24];
    for (int j = 0; j < 3; j++) {
        V w[3];
        for (int k = 0; k < 3; k++) EACH w[k][l] = W[A[k]][j][l] * W[B[k]][j][l];
        for (int i = 0; i < 6; i++) EACH y[i][l] = W[0][j][l] * x[0][i][l] + W[1][j][l] * x[1][i][l] + W[2][j][l] * x[2][i][l];
        int row = 0;
        for (int a = 0; a < 6; a++) for (int b = 2 * (a / 2); b < 6; b++, row++) EACH {
            double s = W[0][j][l] * P[0][row][l] + W[1][j][l] * P[1][row][l] + W[2][j][l] * P[2][row][l];
            for (int k = 0; k < 3; k++) s += w[k][l] * d[k][a][l] * d[k][b][l];
            Q[row][l] = s;
        }
        memcpy(mixed[j], y, sizeof y); memcpy(spread[j], Q, sizeof Q);
    }
    memcpy(x, mixed, sizeof mixed); memcpy(P, spread, sizeof spread); memcpy(mu, c, sizeof c);
}

/* One report for each of n lanes; n is a multiple of eight. reports: east north r_ee r_en r_nn ve vn rv tv, (9, n). */
void imm_step(long n, double *xs, double *Ps, double *mus, const double *h, const double *reports) {
    for (long at = 0; at < n; at += L) {
        V X[MODELS][6], C[MODELS][24], M[MODELS], r[9], H, ok, near;
        for (int m = 0; m < MODELS; m++) {
            for (int i = 0; i < 6; i++) memcpy(X[m][i], xs + (i * MODELS + m) * n + at, sizeof(V));
            for (int i = 0; i < 24; i++) memcpy(C[m][i], Ps + (i * MODELS + m) * n + at, sizeof(V));
            memcpy(M[m], mus + m * n + at, sizeof(V));
        }
        for (int i = 0; i < 9; i++) memcpy(r[i], reports + i * n + at, sizeof(V));
        memcpy(H, h + at, sizeof(V));
        mix(X, C, M, H);
        static const int gone[12] = {4, 5, 10, 11, 14, 15, 18, 19, 20, 21, 22, 23};
        for (int i = 0; i < 12; i++) EACH C[0][gone[i]][l] = 0.0;
        EACH X[0][4][l] = X[0][5][l] = 0.0;
        for (int m = 0; m < MODELS; m++) {
            if (TURNS && m == 1) { circle(X[m], C[m], H, JERK[m]); continue; }
            V q, less, e, n;
            EACH q[l] = TURNS ? 0.0 : JERK[m];
            predict(X[m], C[m], H, q);
            if (TURNS && m == 2) {
                across_of(X[m][2], X[m][3], e, n);
                EACH { q[l] = JERK[m] * H[l]; less[l] = -q[l]; }
                jerk(C[m], H, q, less, e, n);
            }
        }
        for (int m = 0; m < (TURNS ? MODELS : 1); m++) for (int i = 0; i < 2; i++) EACH {
            V *P = C[m];
            int hovers = X[0][2][l] * X[0][2][l] + X[0][3][l] * X[0][3][l] < HOVER * HOVER;
            double q = (m ? WANDER : hovers ? HELD : STEADY) * H[l];
            P11(i, i)[l] += q * H[l] * H[l] / 3.0; P12(i, i)[l] += q * H[l] / 2.0; P22(i, i)[l] += q;
            if (m == 0) P33(i, i)[l] += 1e-4;
        }
        Innovation v[MODELS];
        Gains g;
        V before[2];
        memcpy(before, X[1][2], sizeof before);
        for (int m = 0; m < MODELS; m++) {
            V *S = X[m], *Q = C[m], r00, r01, r11;
            EACH {
                r00[l] = r[2][l] + r[8][l] * (S[2][l] * S[2][l] + Q[12][l]);
                r01[l] = r[3][l] + r[8][l] * (S[2][l] * S[3][l] + Q[13][l]);
                r11[l] = r[4][l] + r[8][l] * (S[3][l] * S[3][l] + Q[17][l]);
            }
            innovate(&v[m], S, Q, 0, r[0], r[1], r00, r01, r11);
        }
        EACH { near[l] = fmin(fmin(v[0].d2[l], v[1].d2[l]), v[2].d2[l]); ok[l] = near[l] <= GATE; }
        for (int m = 0; m < MODELS; m++) apply(X[m], C[m], &v[m], ok, &g);
        reweigh(M, v, ok);
        for (int m = 0; m < MODELS; m++) {
            V r00, r01, r11;
            EACH {
                double ax = X[m][4][l], ay = X[m][5][l];
                r00[l] = r[7][l] + r[8][l] * (ax * ax + C[m][20][l]);
                r01[l] = r[8][l] * (ax * ay + C[m][21][l]);
                r11[l] = r[7][l] + r[8][l] * (ay * ay + C[m][23][l]);
            }
            innovate(&v[m], X[m], C[m], 2, r[5], r[6], r00, r01, r11);
        }
        EACH ok[l] = ok[l] * (fmin(fmin(v[0].d2[l], v[1].d2[l]), v[2].d2[l]) <= GATE);
        for (int m = 0; m < MODELS; m++) apply(X[m], C[m], &v[m], ok, &g);
        reweigh(M, v, ok);
        if (TURNS) keep_speed(X[1], C[1], before[0], before[1]);
        for (int m = 0; m < MODELS; m++) {
            for (int i = 0; i < 6; i++) memcpy(xs + (i * MODELS + m) * n + at, X[m][i], sizeof(V));
            for (int i = 0; i < 24; i++) memcpy(Ps + (i * MODELS + m) * n + at, C[m][i], sizeof(V));
            memcpy(mus + m * n + at, M[m], sizeof(V));
        }
    }
}

static double half_width(double ee, double en, double nn, double e, double n) {
    return fmin(fmax(SIGMAS * sqrt(fmax(ee * e * e + 2.0 * en * e * n + nn * n * n, 0.0)), NARROW), WIDE);
}

/* Between the boundary lines, and not too far along: looked at only where the statistical distance leaves doubt. */
static int inside(const Innovation *v, double vx, double vy, int l) {
    double ee = v->c00[l], en = v->ell[l] * ee, nn = v->s[l] + v->ell[l] * v->ell[l] * ee;
    double speed = hypot(vx, vy), e = 1.0, n = 0.0;
    if (speed >= HOVER) { e = vx / speed; n = vy / speed; }
    double across = half_width(ee, en, nn, -n, e), along = half_width(ee, en, nn, e, n);
    double off = fabs(-n * v->n0[l] + e * v->n1[l]), ahead = fabs(e * v->n0[l] + n * v->n1[l]);
    return speed >= HOVER ? off <= across && ahead <= along : hypot(off, ahead) <= fmax(across, along);
}

static void through_update(V *lam, V A[6][6], int c, const Gains *g) {
    V b0[6], b1[6], e0, e1, g00, g01, g11;
    int d = c + 1;
    EACH { e0[l] = g->m0[l]; e1[l] = g->m1[l]; g00[l] = g11[l] = 1.0; g01[l] = 0.0; }
    for (int i = 0; i < 6; i++) {
        EACH b0[i][l] = b1[i][l] = 0.0;
        for (int j = 0; j < 6; j++) EACH { b0[i][l] += A[i][j][l] * g->a0[j][l]; b1[i][l] += A[i][j][l] * g->a1[j][l]; }
    }
    for (int i = 0; i < 6; i++) EACH {
        e0[l] += g->a0[i][l] * lam[i][l]; e1[l] += g->a1[i][l] * lam[i][l];
        g00[l] += g->a0[i][l] * b0[i][l]; g01[l] += g->a0[i][l] * b1[i][l]; g11[l] += g->a1[i][l] * b1[i][l];
    }
    EACH { lam[c][l] -= g->h00[l] * e0[l] + g->h10[l] * e1[l]; lam[d][l] -= g->h11[l] * e1[l]; }
    for (int i = 0; i < 6; i++) EACH {
        double u0 = g->h00[l] * b0[i][l] + g->h10[l] * b1[i][l], u1 = g->h11[l] * b1[i][l];
        A[c][i][l] -= u0; A[d][i][l] -= u1; A[i][c][l] -= u0; A[i][d][l] -= u1;
    }
    EACH {
        double w00 = g->h00[l] * g00[l] + g->h10[l] * g01[l], w10 = g->h00[l] * g01[l] + g->h10[l] * g11[l];
        A[c][c][l] += w00 * g->h00[l] + w10 * g->h10[l];
        A[c][d][l] += w10 * g->h11[l];
        A[d][c][l] += w10 * g->h11[l];
        A[d][d][l] += g->h11[l] * g11[l] * g->h11[l];
    }
}

static void through_step(V *lam, V A[6][6], const double *h) {
    for (int i = 0; i < 2; i++) {
        for (int j = 0; j < 6; j++) EACH {
            A[4 + i][j][l] += h[l] * A[2 + i][j][l] + 0.5 * h[l] * h[l] * A[i][j][l];
            A[2 + i][j][l] += h[l] * A[i][j][l];
        }
        EACH { lam[4 + i][l] += h[l] * lam[2 + i][l] + 0.5 * h[l] * h[l] * lam[i][l]; lam[2 + i][l] += h[l] * lam[i][l]; }
    }
    for (int i = 0; i < 6; i++) for (int j = 0; j < 2; j++) EACH {
        A[i][4 + j][l] += h[l] * A[i][2 + j][l] + 0.5 * h[l] * h[l] * A[i][j][l];
        A[i][2 + j][l] += h[l] * A[i][j][l];
    }
}

static void through_turn(V *lam, V A[6][6], const double *c, const double *s) {
    EACH TURNED(lam[4], lam[5], c[l], -s[l])
    for (int j = 0; j < 6; j++) EACH TURNED(A[4][j], A[5][j], c[l], -s[l])
    for (int i = 0; i < 6; i++) EACH TURNED(A[i][4], A[i][5], c[l], -s[l])
}

#define MOST 512
static Gains kept[MOST][2];
static V steps[MOST], turns[MOST][2];

/* Both passes over the windows of n lanes (a multiple of eight) with K events (at most 512). reports (9, K, n) in the
 * order of imm_step, kind 1 for a report, 2 for the centre, 0 behind the last event. Gives x (6, n) and P (36, n). */
void close_elements(long n, long K, const signed char *kind, const double *time, const double *q, const double *reports,
                    const double *x, const double *P, const double *t, double *out_x, double *out_P) {
    for (long at = 0; at < n; at += L) {
        V X[6], C[24], T, Xc[6] = {{0}}, Cc[24] = {{0}}, lam[6] = {{0}}, A[6][6] = {{{0}}}, lc[6] = {{0}}, Ac[6][6] = {{{0}}};
        for (int i = 0; i < 6; i++) memcpy(X[i], x + i * n + at, sizeof(V));
        for (int i = 0; i < 24; i++) memcpy(C[i], P + i * n + at, sizeof(V));
        memcpy(T, t + at, sizeof(V));
        long last = 0;
        for (long k = 0; k < K; k++) {
            const signed char *what = kind + k * n + at;
            V r[9], r00, r01, r11, ok, has, along, across;
            int some = 0;
            EACH some |= what[l] != 0;
            if (!some) break;
            last = k + 1;
            EACH {
                double when = time[k * n + at + l];
                steps[k][l] = what[l] ? when - T[l] : 0.0;
                if (what[l]) T[l] = when;
                ok[l] = what[l] == 1;
            }
            EACH { along[l] = ALONG_SHARE * q[k * n + at + l]; across[l] = ACROSS_SHARE * q[k * n + at + l]; }
            turn(X, C, steps[k], along, across, turns[k]);
            for (int i = 0; i < 9; i++) EACH {
                double value = reports[(i * K + k) * n + at + l];
                r[i][l] = ok[l] > 0.0 ? value : (i == 2 || i == 4);
            }
            EACH {
                has[l] = ok[l] > 0.0 && isfinite(r[7][l]);
                if (!(has[l] > 0.0)) { r[5][l] = r[6][l] = 0.0; r[7][l] = 1.0; }
                r00[l] = r[2][l] + r[8][l] * (X[2][l] * X[2][l] + C[12][l]);
                r01[l] = r[3][l] + r[8][l] * (X[2][l] * X[3][l] + C[13][l]);
                r11[l] = r[4][l] + r[8][l] * (X[3][l] * X[3][l] + C[17][l]);
            }
            Innovation v;
            innovate(&v, X, C, 0, r[0], r[1], r00, r01, r11);
            EACH {
                if (ok[l] > 0.0 && v.d2[l] > DOUBT && !inside(&v, X[2][l], X[3][l], l)) ok[l] = 0.0;
                ok[l] = ok[l] * (v.d2[l] <= GATE);
            }
            apply(X, C, &v, ok, &kept[k][0]);
            EACH {
                r00[l] = r[7][l] + r[8][l] * (X[4][l] * X[4][l] + C[20][l]);
                r01[l] = r[8][l] * (X[4][l] * X[5][l] + C[21][l]);
                r11[l] = r[7][l] + r[8][l] * (X[5][l] * X[5][l] + C[23][l]);
            }
            innovate(&v, X, C, 2, r[5], r[6], r00, r01, r11);
            EACH ok[l] = ok[l] * has[l] * (v.d2[l] <= GATE);
            apply(X, C, &v, ok, &kept[k][1]);
            EACH if (what[l] == 2) {
                for (int i = 0; i < 6; i++) Xc[i][l] = X[i][l];
                for (int i = 0; i < 24; i++) Cc[i][l] = C[i][l];
            }
        }
        for (long k = last - 1; k >= 0; k--) {
            const signed char *what = kind + k * n + at;
            EACH if (what[l] == 2) for (int i = 0; i < 6; i++) {
                lc[i][l] = lam[i][l];
                for (int j = 0; j < 6; j++) Ac[i][j][l] = A[i][j][l];
            }
            through_update(lam, A, 2, &kept[k][1]);
            through_update(lam, A, 0, &kept[k][0]);
            through_turn(lam, A, turns[k][0], turns[k][1]);
            through_step(lam, A, steps[k]);
        }
        for (int i = 0; i < 6; i++) {
            V s, PA[6];
            memcpy(s, Xc[i], sizeof s);
            for (int j = 0; j < 6; j++) {
                EACH s[l] -= Cc[row_of(i, j)][l] * lc[j][l];
                EACH PA[j][l] = 0.0;
                for (int m = 0; m < 6; m++) EACH PA[j][l] += Cc[row_of(i, m)][l] * Ac[m][j][l];
            }
            memcpy(out_x + i * n + at, s, sizeof s);
            for (int j = 0; j < 6; j++) {
                memcpy(s, Cc[row_of(i, j)], sizeof s);
                for (int m = 0; m < 6; m++) EACH s[l] -= PA[m][l] * Cc[row_of(m, j)][l];
                memcpy(out_P + (6 * i + j) * n + at, s, sizeof s);
            }
        }
    }
}
